"""What README.md says, done against a board of its own: only names, places and ports are others."""

import os
import pathlib
import re
import shlex
import subprocess
import sys
import tempfile

import pytest
from board_of_processes import PROGRAMS, until
from conftest import addresses

PAGE = (pathlib.Path(__file__).parents[1] / "README.md").read_text()
BLOCKS = re.findall(r"```([^\n]+)\n(.*?)```", PAGE, re.DOTALL)
BINARIES = pathlib.Path(sys.executable).parent


def bodies(kind):
    return [body for found, body in BLOCKS if found == kind]


def same(text):
    """``text`` without its numbers, and with single spaces."""
    return re.sub(r"-?\d+(\.\d+)?(e-?\d+)?", "N", " ".join(text.split()))


class Page:
    """The page's processes, started as it says, and its commands in their environment."""

    def __init__(self, directory):
        self.directory = pathlib.Path(directory)
        self.name = "page" + self.directory.name.replace("_", "-")
        self.prefix = f"{self.name.upper()}:"
        path = f"{BINARIES}:{os.environ['PATH']}"
        self.environment = {**os.environ, **addresses(), "PATH": path}
        self._running = []

    def own(self, text):
        places = {
            "target/release/pmacd": f"{PROGRAMS}/pmacd --name {self.name}",
            "target/epics/bin": str(BINARIES),
            "/tmp/pmac0.sock": f"{self.directory}/socket",
            "PMAC0:": self.prefix,
        }
        for place, other in places.items():
            text = text.replace(place, other)
        return text

    def start(self, body):
        with open(self.directory / "log", "a") as log:
            command = shlex.split(self.own(body))
            self._running.append(subprocess.Popen(command, env=self.environment, stdout=log, stderr=log))

    def run(self, command):
        return subprocess.run(command, env=self.environment, capture_output=True, text=True, timeout=60)

    def shell(self, line):
        return self.run(["sh", "-c", self.own(line)])

    def close(self):
        for child in reversed(self._running):
            child.terminate()
            child.wait(30)


@pytest.fixture(scope="module")
def page():
    with tempfile.TemporaryDirectory(dir="/dev/shm") as directory:
        page = Page(directory)
        try:
            for body in bodies("sh start"):
                page.start(body)
            until(lambda: "In position" in page.shell("caget -w 2 PMAC0:M1:STAT").stdout, "the page's server")
            yield page
        finally:
            page.close()


def test_the_commands_of_the_page_print_what_it_shows(page):
    (dialogue,) = bodies("console")
    pairs = re.findall(r"^\$ ([^\n]+)\n(.*?)(?=^\$ |\Z)", dialogue, re.DOTALL | re.MULTILINE)
    assert len(pairs) == 4
    for command, shown in pairs:
        done = page.shell(command)
        assert (done.returncode, same(done.stdout)) == (0, same(page.own(shown))), done.stderr


def test_the_python_examples_of_the_page_run(page):
    table, scan = bodies("python")
    done = page.run([sys.executable, "-c", page.own(table)])
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("['update', 'timer', 'time', 'pos1'] "), done.stdout
    done = page.run([sys.executable, "-c", page.own(scan)])
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["start", "descriptor", "event", "event", "event", "stop"]


def test_the_other_commands_are_shell(page):
    kinds = {kind.split(":")[0] for kind, _ in BLOCKS}
    assert kinds == {"sh install", "sh start", "sh no-run", "console", "python"}
    for kind, body in BLOCKS:
        if kind.startswith("sh"):
            assert subprocess.run(["sh", "-n"], input=body, text=True).returncode == 0, body


def test_every_record_of_the_page_exists(ioc):
    names = set()
    for row in re.findall(r"^\| (`[^|]+) \|", PAGE, re.MULTILINE):
        group = ""
        for name in re.findall(r"`([^`]+)`", row):
            group = name.rpartition(":")[0] if not name.startswith(":") else group
            names.add(group + name if name.startswith(":") else name)
    assert len(names) > 30
    assert [name for name in sorted(names) if ioc.get(name) is None] == []
