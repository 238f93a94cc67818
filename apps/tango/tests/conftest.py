"""A simulated board of each generation, its daemon, and a PmacEth server on a port of its own."""

import sys
import tempfile

import pytest
import tango
from site_of_processes import LOOPBACK, Site, free_ports

DEVICE = "pmac/eth/1"
FAMILIES = {
    "classic": {},
    "turbo": {
        "simulator": ("--family", "turbo2"),
        "configuration": 'family = "turbo2"\n[servo]\nmotors = [1, 2, 3, 4, 5, 6, 7, 8]\n',
    },
}


class TangoSite(Site):
    """A site with a device server."""

    def start_server(self, *options):
        """A proxy of its device, once it answers."""
        (port,) = free_ports(1)
        place = ("--name", self.name, "--socket", self.socket)
        tango_options = ("-ORBendPoint", f"giop:tcp:{LOOPBACK}:{port}", *(options or ("-nodb", "-dlist", DEVICE)))
        server = self.run(sys.executable, "-m", "pmac_tango", *place, "test", *tango_options)

        def proxy():
            assert server.poll() is None, self.log()
            try:
                found = tango.DeviceProxy(f"tango://{LOOPBACK}:{port}/{DEVICE}#dbase=no")
                found.ping()
                return found
            except tango.DevFailed:
                return None

        return self.until(proxy, "the device server")

    def status(self, motor):
        """Its flags, of live data."""
        return self.snapshot().motor[motor].status

    def make_ready(self):
        """Closes the loops of all motors, and brings them to 0."""
        board = self.connect()
        board.command("".join(f"#{motor}J/" for motor in range(1, 9)))
        board.command("".join(f"#{motor}J=0" for motor in range(1, 9)))

        def at_zero():
            positions, states = (board.control(character)[0].split() for character in ("^P", "^B"))
            # The last bit of a state: in position.
            return set(positions) == {"0"} and all(int(state, 16) & 1 for state in states)

        self.until(at_zero, "the motors at 0")


@pytest.fixture(scope="session", params=FAMILIES)
def site(request):
    with tempfile.TemporaryDirectory(dir="/dev/shm") as directory:
        site = TangoSite(directory, **FAMILIES[request.param])
        site.family = request.param
        site.proxy = site.start_server()
        site.device = f"tango://{site.proxy.get_dev_host()}:{site.proxy.get_dev_port()}/{DEVICE}#dbase=no"
        yield site
        site.close()


@pytest.fixture
def device(site):
    site.make_ready()
    return site.proxy
