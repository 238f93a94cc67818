"""The programs examples/mqtt.py and examples/opcua.py, run as they stand, but for names and ports."""

import sys
import tempfile

import pytest
from board_of_processes import REPOSITORY
from site_of_processes import Site


@pytest.fixture
def site():
    with tempfile.TemporaryDirectory(dir="/dev/shm") as directory:
        site = Site(directory)
        yield site
        site.close()


@pytest.fixture
def example(site):
    """Starts one of the programs."""

    def start(name, changes):
        program = (REPOSITORY / "examples" / f"{name}.py").read_text()
        changes = {'connect("pmac0")': f'connect("{site.name}", "{site.socket}")', **changes}
        for old, new in changes.items():
            assert program.count(old) == 1, f"{name}: {old}"
            program = program.replace(old, new)
        return site.run(sys.executable, "-c", program)

    return start
