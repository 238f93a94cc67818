"""A simulated board, its daemon and a gateway as processes, with names, sockets and a port that nobody else has."""

import socket

from board_of_processes import PROGRAMS, Board

LISTENING = "pmac-gateway: listening on "


class Site(Board):
    """A board of ``family``, and a gateway with the further options ``gateway``."""

    def __init__(self, directory, family, *, simulator=(), gateway=()):
        self._control = f"{directory}/control"
        simulator = ["--family", family, "--control", f"unix:{self._control}", *simulator]
        super().__init__(directory, simulator=simulator, configuration=f'family = "{family}"\n')
        try:
            # The system chooses the port.
            place = ("--socket", self.socket, "--listen", "127.0.0.1:0")
            self.gateway = self.run(PROGRAMS / "pmac-gateway", *place, *gateway)
            self.until_up(self.gateway, lambda: LISTENING in self.log(), "the gateway")
        except BaseException:
            self.close()
            raise
        host, port = self.log().split(LISTENING)[1].split()[0].split(":")
        self.address = host, int(port)

    def has_told(self, line):
        """Whether the gateway has logged ``line`` of a client."""
        lines = self.log().splitlines()
        return any(told.startswith("pmac-gateway: 127.0.0.1:") and told.endswith(f": {line}") for told in lines)

    def control(self, command):
        """Changes the world around the board."""
        with socket.socket(socket.AF_UNIX) as control:
            control.connect(self._control)
            control.sendall(f"{command}\n".encode())
            assert control.recv(1000) == b"ok\n", command

    def send(self, line):
        """The lines that the board answers, asked beside the gateway."""
        ran = self.pmacctl("send", line)
        assert ran.returncode == 0, ran.stderr
        return ran.stdout.splitlines()

    def position(self, motor):
        return float(self.send(f"#{motor}P")[0])
