"""A simulated board and its daemon for each test that asks for one, from the programs that cargo has built."""

import tempfile

import pytest
from site_of_processes import Site


@pytest.fixture
def site(new_site):
    return new_site()


@pytest.fixture
def new_site():
    """Makes sites with other settings."""
    sites, directories = [], []

    def new(**settings):
        directories.append(tempfile.TemporaryDirectory(dir="/dev/shm"))
        sites.append(Site(directories[-1].name, **settings))
        return sites[-1]

    yield new
    for site in sites:
        site.close()
    for directory in directories:
        directory.cleanup()
