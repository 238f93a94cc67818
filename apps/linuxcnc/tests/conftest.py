"""A simulated board, its daemon and the HAL component, and halcmd of LinuxCNC's package to look at its pins.

LinuxCNC is taken from PATH, or else from its Debian package, which is unpacked under target/ and not installed. HAL is one for the whole
machine, so root runs the tests in an IPC namespace of their own.
"""

import ctypes
import os
import shutil
import subprocess
import sys
import tempfile

import pytest
from board_of_processes import REPOSITORY
from site_of_processes import Site

UNPACKED = REPOSITORY / "target" / "apps" / "linuxcnc-uspace"
CLONE_NEWIPC = 0x08000000
TURBO = {"simulator": ("--family", "turbo2"), "configuration": 'family = "turbo2"\n[servo]\nmotors = [1, 2]\n'}


def halcmd(*words):
    """What halcmd prints."""
    done = subprocess.run(["halcmd", "-s", *words], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, f"halcmd {' '.join(words)}: {done.stdout}{done.stderr}"
    return done.stdout.strip()


@pytest.fixture(scope="session", autouse=True)
def linuxcnc():
    """halcmd and the module hal, for this process' children; and a HAL that nobody else uses."""
    if not shutil.which("halcmd"):
        if not shutil.which("dpkg-deb"):
            pytest.skip("there is no LinuxCNC, and this is no Debian to take it from")
        if not (UNPACKED / "usr/bin/halcmd").exists():
            unpack()
        paths = {"PATH": "usr/bin", "LD_LIBRARY_PATH": "usr/lib", "PYTHONPATH": "usr/lib/python3/dist-packages"}
        for variable, folder in paths.items():
            os.environ[variable] = f"{UNPACKED / folder}:{os.environ.get(variable, '')}".rstrip(":")
    os.environ["PATH"] = f"{os.path.dirname(sys.executable)}:{os.environ['PATH']}"
    if os.geteuid() == 0:
        assert ctypes.CDLL(None, use_errno=True).unshare(CLONE_NEWIPC) == 0, os.strerror(ctypes.get_errno())
    assert "pmac" not in halcmd("show", "comp"), "HAL is in use; run the tests as root, or unload what uses it"


def unpack():
    """Fetches LinuxCNC's package and unpacks it."""
    with tempfile.TemporaryDirectory() as directory:
        os.chmod(directory, 0o777)
        fetch = ["apt-get", "-q", "download", "linuxcnc-uspace"]
        if subprocess.run(fetch, cwd=directory, timeout=300).returncode != 0:
            # The lists of packages are missing or old.
            subprocess.run(["apt-get", "-q", "update"], check=True, timeout=300)
            subprocess.run(fetch, cwd=directory, check=True, timeout=300)
        (package,) = os.listdir(directory)
        UNPACKED.parent.mkdir(parents=True, exist_ok=True)
        whole = UNPACKED.with_suffix(".new")
        subprocess.run(["dpkg-deb", "--extract", f"{directory}/{package}", whole], check=True, timeout=300)
        whole.rename(UNPACKED)


class HalSite(Site):
    """A site with a component."""

    components = 0

    def start_component(self, *options):
        HalSite.components += 1
        self.component = f"pmac{HalSite.components}"
        place = ("--name", self.name, "--socket", self.socket, "--component", self.component)
        self.process = self.run(sys.executable, "-m", "pmac_hal", *place, *options)

        def is_ready():
            assert self.process.poll() is None, self.log()
            return f"{self.component} " in halcmd("show", "comp") and self.get("live") == "TRUE"

        self.until(is_ready, "the component")

    def get(self, pin):
        return halcmd("getp", f"{self.component}.{pin}")

    def set(self, pin, value):
        halcmd("setp", f"{self.component}.{pin}", str(value))

    def wait_for_a_look(self):
        """Waits until the component has seen the pins as they are now."""
        for value in ("TRUE", "FALSE", "TRUE"):
            self.until(lambda value=value: self.get("heartbeat") == value, "a heartbeat")

    def position(self, motor):
        """As the pin has it."""
        return float(self.get(f"motor.{motor}.position"))

    def velocity(self, motor):
        """As the board has it."""
        return self.snapshot().motor[motor].velocity

    def moves(self, motor):
        status = self.snapshot().motor[motor].status
        return status.desired_velocity_zero is False

    def stands(self, motor):
        return not self.moves(motor)

    def pins(self):
        """The names of all pins, without the component's."""
        lines = halcmd("show", "pin", f"{self.component}.*").splitlines()
        return {line.split()[4].removeprefix(f"{self.component}.") for line in lines}

    def make_ready(self):
        """Ends what a test may have left, closes all loops and brings the motors to 0."""
        for motor in self.motors:
            self.set(f"motor.{motor}.jog", 0)
            self.set(f"motor.{motor}.abort", 0)
        board = self.connect()
        self.until(lambda: all(self.get(f"motor.{motor}.jogging") == "FALSE" for motor in self.motors), "the end of jogs")
        board.control("^A")
        board.command("".join(f"#{motor}J/" for motor in self.motors))
        board.command("".join(f"#{motor}J=0" for motor in self.motors))

        def at_zero():
            return all(self.stands(motor) and abs(self.position(motor)) < 1 for motor in self.motors)

        self.until(at_zero, "the motors at 0")


def new_site(directory, **options):
    site = HalSite(directory, **options)
    site.motors = list(site.snapshot().motor)
    return site


@pytest.fixture(scope="module")
def long_site():
    unit = '[[motor]]\nnumber = 2\nname = "azimuth"\nunit = "deg"\ncounts_per_unit = 1000\n'
    with tempfile.TemporaryDirectory(dir="/dev/shm") as directory:
        site = new_site(directory, configuration=unit)
        yield site
        site.close()


@pytest.fixture
def site(long_site):
    """A site whose component runs and whose motors stand at 0."""
    if getattr(long_site, "process", None) is None or long_site.process.poll() is not None:
        long_site.start_component()
    long_site.make_ready()
    return long_site


@pytest.fixture
def turbo_site():
    with tempfile.TemporaryDirectory(dir="/dev/shm") as directory:
        site = new_site(directory, **TURBO)
        site.start_component()
        yield site
        site.close()
