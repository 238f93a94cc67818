"""A board with its EPICS server on ports of its own, and clients of both protocols that find only this one."""

import asyncio
import os
import socket
import sys
import tempfile

import pytest
from site_of_processes import LOOPBACK, Site, free_ports


_repeaters = []


def addresses():
    """The environment of servers and clients that meet on ports of their own and see nobody else."""
    ca, pva_tcp, pva_udp = map(str, free_ports(3))
    # A port that is in use has its repeater: no client starts one, which would outlive the tests.
    _repeaters.append(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    _repeaters[-1].bind((LOOPBACK, 0))
    repeater = str(_repeaters[-1].getsockname()[1])
    return {
        "EPICS_CA_ADDR_LIST": LOOPBACK,
        "EPICS_CA_AUTO_ADDR_LIST": "NO",
        "EPICS_CA_SERVER_PORT": ca,
        "EPICS_CA_REPEATER_PORT": repeater,
        "EPICS_CAS_SERVER_PORT": ca,
        "EPICS_CAS_BEACON_ADDR_LIST": LOOPBACK,
        "EPICS_CAS_AUTO_BEACON_ADDR_LIST": "NO",
        "EPICS_PVA_ADDR_LIST": f"{LOOPBACK}:{pva_udp}",
        "EPICS_PVA_AUTO_ADDR_LIST": "NO",
        "EPICS_PVA_BROADCAST_PORT": pva_udp,
        "EPICS_PVAS_SERVER_PORT": pva_tcp,
        "EPICS_PVAS_BROADCAST_PORT": pva_udp,
        "EPICS_PVAS_BEACON_ADDR_LIST": LOOPBACK,
        "EPICS_PVAS_AUTO_BEACON_ADDR_LIST": "NO",
    }


# Before any client library is loaded: it reads its environment then.
os.environ.update(addresses())

# One client library for pyepics and aioca.
import epicscorelibs.path.pyepics  # noqa: E402, F401


def with_aioca(coroutine):
    """What ``coroutine`` returns. No channel of aioca outlives its event loop."""
    import aioca

    async def run():
        try:
            return await coroutine
        finally:
            aioca.purge_channel_caches()

    return asyncio.run(run())


PREFIX = "TEST:"
# Motor 2 has a unit of its own, the others are in counts.
MOTOR_2 = '[[motor]]\nnumber = 2\nname = "azimuth"\nunit = "deg"\ncounts_per_unit = 1000\n'
WORDS = """
[[user]]
name = "count"
address = "$DA10"
format = "DP"
unit = "part"

[[user]]
name = "pair.of"
address = "$DA11"
format = "Y"
count = 2

[[user]]
name = "held"
address = "$DA13"
format = "DP"
guard = "Y:$DA0F"
"""


class Ioc:
    """The EPICS server of a site, and what PV Access says of it."""

    def __init__(self, site, context, prefix=PREFIX, options=(), environment=None):
        self.site, self.prefix, self._context = site, prefix, context
        place = ("--name", site.name, "--socket", site.socket, "--prefix", prefix)
        environment = {**os.environ, **(environment or {})}
        self.process = site.run(sys.executable, "-m", "pmac_epics", *place, *options, env=environment)
        site.until(self._answers, "the EPICS server")
        self.until_live()

    def _answers(self):
        assert self.process.poll() is None, self.site.log()
        return self.get("CONN") is not None

    def get(self, record):
        """The PV Access structure of ``record``, or None where nobody has it."""
        try:
            return self._context.get(self.prefix + record, timeout=2)
        except TimeoutError:
            return None

    def value(self, record):
        """The value of ``record``; of an enumeration its text."""
        value = self.get(record).value
        return value.choices[value.index] if hasattr(value, "choices") else value

    def put(self, record, value):
        """Puts ``value``; returns when the server has done what it asks for."""
        self._context.put(self.prefix + record, value, timeout=30, wait=True)

    def is_invalid(self, *records):
        """Whether each of ``records`` has the alarm INVALID."""
        return all(self.get(record).alarm.severity == 3 for record in records)

    def until_live(self):
        self.site.until(lambda: self.value("CONN") == "Live" and not self.is_invalid("M1:RBV"), "live records")


@pytest.fixture(scope="session")
def site():
    with tempfile.TemporaryDirectory(dir="/dev/shm") as directory:
        site = Site(directory, configuration=MOTOR_2 + WORDS)
        yield site
        site.close()


@pytest.fixture(scope="session")
def context():
    from p4p.client.thread import Context

    with Context("pva", nt=False) as context:
        yield context


@pytest.fixture(scope="session")
def _ioc(site, context):
    return Ioc(site, context)


@pytest.fixture
def ioc(_ioc):
    """The server, its board with all motors standing in closed loop at 0, nothing told as wrong."""
    board = _ioc.site.connect()
    board.command(" ".join(f"#{number}J/" for number in range(1, 9)))
    board.command(" ".join(f"#{number}J=0" for number in range(1, 9)))

    def at_zero():
        motors = board.snapshot(stale_ok=True).motor
        return all(abs(motors[n].position) < 1 and motors[n].status.in_position for n in motors)

    _ioc.site.until(at_zero, "the motors at 0")
    _ioc.site.until(lambda: _ioc.value("M1:DMOV") == _ioc.value("M2:DMOV") == "Done", "the records of motors at rest")
    return _ioc
