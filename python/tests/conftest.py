"""A simulated board and its daemon for each test that asks for one, from the programs that cargo has built."""

import os
import pathlib
import subprocess
import tempfile
import time

import pmac_dpram
import pytest

PROGRAMS = pathlib.Path(os.environ.get("PMAC_PROGRAMS", pathlib.Path(__file__).parents[2] / "target" / "debug"))


class Site:
    """A board called `name`."""

    def __init__(self, directory, hz=None):
        self.name = "py" + os.path.basename(directory).replace("_", "-")
        self.socket = f"{directory}/socket"
        self.directory = directory
        self.hz = hz
        self.programs = []
        memory = f"{directory}/dpram"
        startup = ["--dpram-startup", *(["--servo-hz", str(hz)] if hz else [])]
        self.run("pmac-sim", "--memory", memory, "--interrupt", f"unix:{directory}/irq", *startup)
        self.until(lambda: os.path.exists(f"{directory}/irq"), "the simulator")
        self.start_daemon()

    def start_daemon(self):
        board = f"file:{self.directory}/dpram,irq=unix:{self.directory}/irq"
        self.daemon = self.run("pmacd", "--board", board, "--name", self.name, "--socket", self.socket)
        self.until(self.is_live, "live data")

    def run(self, program, *arguments):
        log = open(f"{self.directory}/{program}.log", "a")
        child = subprocess.Popen([PROGRAMS / program, *arguments], stdout=log, stderr=log)
        self.programs.append(child)
        return child

    def log(self):
        with open(f"{self.directory}/pmacd.log") as log:
            return log.read()

    def is_live(self):
        try:
            motor = self.connect().snapshot().motor[1]
            return motor.position is not None and motor.status.in_position is not None
        except pmac_dpram.PmacError:
            return False

    def connect(self):
        return pmac_dpram.Board(self.name, self.socket)

    def until(self, condition, what, patience=30):
        end = time.monotonic() + patience
        while not condition():
            assert time.monotonic() < end, f"waited in vain for {what}"
            time.sleep(0.01)

    def close(self):
        for child in reversed(self.programs):
            child.terminate()
            child.wait(10)


@pytest.fixture
def site():
    with tempfile.TemporaryDirectory(dir="/dev/shm") as directory:
        site = Site(directory)
        yield site
        site.close()


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
