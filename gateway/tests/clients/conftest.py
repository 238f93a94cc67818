"""A simulated Turbo PMAC2 behind a gateway of its own for each test that asks for one."""

import tempfile

import pytest
from gateway_of_processes import Site


@pytest.fixture
def new_site():
    """Makes sites; see `Site`."""
    sites, directories = [], []

    def new(family="turbo2", **settings):
        directories.append(tempfile.TemporaryDirectory(prefix="clients-", dir="/dev/shm"))
        sites.append(Site(directories[-1].name, family, **settings))
        return sites[-1]

    yield new
    for site in sites:
        site.close()
    for directory in directories:
        directory.cleanup()


@pytest.fixture
def site(new_site):
    return new_site()
