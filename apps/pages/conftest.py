"""The examples of docs/mqtt.md and docs/opcua.md, run as they stand, but for names and ports."""

import re
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
    """Starts the program of a page."""

    def start(page, changes):
        text = (REPOSITORY / "docs" / f"{page}.md").read_text()
        (program,) = re.findall(r"```python apps\n(.*?)```", text, re.DOTALL)
        changes = {'connect("pmac0")': f'connect("{site.name}", "{site.socket}")', **changes}
        for old, new in changes.items():
            assert program.count(old) == 1, f"{page}: {old}"
            program = program.replace(old, new)
        return site.run(sys.executable, "-c", program)

    return start
