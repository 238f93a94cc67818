"""A simulated board, its daemon and its EPICS server on ports of their own, and clients of both protocols that find only these."""

import os
import pathlib
import socket
import subprocess
import sys
import tempfile
import time

import pytest


def free_ports(count):
    """Ports that nobody uses now, neither by TCP nor by UDP."""
    held, ports = [], []
    while len(ports) < count:
        tcp = socket.socket()
        tcp.bind(("127.0.0.1", 0))
        port = tcp.getsockname()[1]
        udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        held += [tcp, udp]
        try:
            udp.bind(("127.0.0.1", port))
        except OSError:
            continue
        ports.append(port)
    for each in held:
        each.close()
    return ports


CA, REPEATER, PVA_TCP, PVA_UDP = free_ports(4)
LOOPBACK = "127.0.0.1"
# Before any client library is loaded: it reads its environment then.
os.environ.update(
    {
        "EPICS_CA_ADDR_LIST": LOOPBACK,
        "EPICS_CA_AUTO_ADDR_LIST": "NO",
        "EPICS_CA_SERVER_PORT": str(CA),
        "EPICS_CA_REPEATER_PORT": str(REPEATER),
        "EPICS_CAS_SERVER_PORT": str(CA),
        "EPICS_CAS_BEACON_ADDR_LIST": LOOPBACK,
        "EPICS_CAS_AUTO_BEACON_ADDR_LIST": "NO",
        "EPICS_PVA_ADDR_LIST": f"{LOOPBACK}:{PVA_UDP}",
        "EPICS_PVA_AUTO_ADDR_LIST": "NO",
        "EPICS_PVA_BROADCAST_PORT": str(PVA_UDP),
        "EPICS_PVAS_SERVER_PORT": str(PVA_TCP),
        "EPICS_PVAS_BROADCAST_PORT": str(PVA_UDP),
        "EPICS_PVAS_BEACON_ADDR_LIST": LOOPBACK,
        "EPICS_PVAS_AUTO_BEACON_ADDR_LIST": "NO",
    }
)

import epicscorelibs.path  # noqa: E402

# One client library for pyepics and aioca.
os.environ["PYEPICS_LIBCA"] = epicscorelibs.path.get_lib("ca")

import pmac_dpram  # noqa: E402

PROGRAMS = pathlib.Path(os.environ.get("PMAC_PROGRAMS", pathlib.Path(__file__).parents[3] / "target" / "debug"))
PREFIX = "TEST:"
MOTOR_2 = '[[motor]]\nnumber = 2\nname = "azimuth"\nunit = "deg"\ncounts_per_unit = 1000\n'


def until(condition, what, patience=60):
    """Waits for ``condition`` and returns what it gave."""
    end = time.monotonic() + patience
    while not (found := condition()):
        assert time.monotonic() < end, f"waited in vain for {what}"
        time.sleep(0.02)
    return found


class Site:
    """The three programs, in ``directory``."""

    def __init__(self, directory):
        self.directory = directory
        self.name = "ioc" + os.path.basename(directory).replace("_", "-")
        self.socket = f"{directory}/socket"
        self.configuration = f"{directory}/pmacd.toml"
        pathlib.Path(self.configuration).write_text(MOTOR_2)
        self.programs = []
        self.simulator = self.run(
            PROGRAMS / "pmac-sim",
            "--memory", f"{directory}/dpram",
            "--interrupt", f"unix:{directory}/irq",
            "--dpram-startup",
        )
        until(lambda: os.path.exists(f"{directory}/irq"), "the simulator")
        self.start_daemon()

    def start_daemon(self):
        board = f"file:{self.directory}/dpram,irq=unix:{self.directory}/irq"
        place = ["--name", self.name, "--socket", self.socket]
        self.daemon = self.run(PROGRAMS / "pmacd", "--config", self.configuration, "--board", board, *place)
        until(self.is_live, "live data")

    def start_server(self, *options):
        options = options or ("--name", self.name, "--socket", self.socket)
        return self.run(sys.executable, "-m", "pmac_epics", *options, "--prefix", PREFIX)

    def run(self, program, *arguments):
        with open(f"{self.directory}/log", "a") as log:
            child = subprocess.Popen([program, *arguments], stdin=subprocess.DEVNULL, stdout=log, stderr=log)
        self.programs.append(child)
        return child

    def log(self):
        return pathlib.Path(f"{self.directory}/log").read_text()

    def board(self):
        return pmac_dpram.connect(self.name, self.socket)

    def is_live(self):
        try:
            return self.board().snapshot().motor[1].status.in_position is not None
        except pmac_dpram.PmacError:
            return False

    def end(self, child):
        child.terminate()
        try:
            child.wait(15)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()

    def close(self):
        for child in reversed(self.programs):
            self.end(child)


@pytest.fixture(scope="session")
def site():
    with tempfile.TemporaryDirectory(dir="/dev/shm") as directory:
        site = Site(directory)
        yield site
        site.close()
        if os.environ.get("PMAC_SHOW_LOG"):
            print(site.log())


@pytest.fixture(scope="session")
def context():
    from p4p.client.thread import Context

    with Context("pva", nt=False) as context:
        yield context


@pytest.fixture(scope="session")
def server(site, context):
    """The server's process, once it answers."""
    server = site.start_server()

    def answers():
        assert server.poll() is None, site.log()
        return get(context, "CONN") is not None

    until(answers, "the server")
    until(lambda: get(context, "CONN").value.index == 0, "live records")
    return server


def get(context, record):
    """The PVA value of ``record``, or None."""
    try:
        return context.get(PREFIX + record, timeout=2)
    except TimeoutError:
        return None


@pytest.fixture
def board(site, server):
    """The board with all motors standing in closed loop at 0."""
    board = site.board()
    board.command(" ".join(f"#{number}J/" for number in range(1, 9)))
    board.command(" ".join(f"#{number}J=0" for number in range(1, 9)))

    def at_zero():
        motors = board.snapshot().motor
        return all(abs(motors[n].position) < 1 and motors[n].status.in_position for n in motors)

    until(at_zero, "the motors at 0")
    return board
