"""A board as :mod:`board_of_processes` has it, seen by the Python package, and ports for further programs."""

import socket

import pmac_dpram
from board_of_processes import Board

LOOPBACK = "127.0.0.1"


def free_ports(count):
    """Ports of this machine that nobody uses now, neither by TCP nor by UDP."""
    held, ports = [], []
    while len(ports) < count:
        tcp = socket.socket()
        tcp.bind((LOOPBACK, 0))
        port = tcp.getsockname()[1]
        udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        held += [tcp, udp]
        try:
            udp.bind((LOOPBACK, port))
        except OSError:
            continue
        ports.append(port)
    for each in held:
        each.close()
    return ports


class Site(Board):
    """A board that is live when its data are."""

    def connect(self):
        return pmac_dpram.Board(self.name, self.socket)

    def snapshot(self):
        """Live data. On a busy machine the board may be late."""

        def live():
            try:
                return self.connect().snapshot()
            except pmac_dpram.StaleData:
                return None

        return self.until(live, "live data")

    def is_live(self):
        """Whether servo and background data come, and positions have their scale."""
        try:
            snapshot = self.connect().snapshot()
        except pmac_dpram.PmacError:
            return False
        return snapshot.motor[1].position is not None and len(snapshot.system) > 0
