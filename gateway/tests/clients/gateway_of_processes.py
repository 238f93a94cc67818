"""A simulated board, its daemon and a gateway as processes, with names, sockets and a port that nobody else has."""

import os
import pathlib
import subprocess
import time

REPOSITORY = pathlib.Path(__file__).parents[3]
PROGRAMS = pathlib.Path(os.environ.get("PMAC_PROGRAMS", REPOSITORY / "target" / "debug"))
LISTENING = "listening on "


def until(condition, what, patience=60):
    """Waits for `condition` and returns what it gave."""
    end = time.monotonic() + patience
    while not (found := condition()):
        assert time.monotonic() < end, f"waited in vain for {what}"
        time.sleep(0.02)
    return found


class Site:
    """A board of `family`. All files are in `directory`, which is empty and lies in /dev/shm."""

    def __init__(self, directory, family, *, simulator=(), gateway=()):
        """`simulator`, `gateway`: their further options."""
        self.directory = pathlib.Path(directory)
        self._socket = str(self.directory / "socket")
        self._children = []
        memory, interrupt = self.directory / "dpram", self.directory / "irq"
        configuration = self.directory / "pmacd.toml"
        configuration.write_text(f'family = "{family}"\n')
        board = f"file:{memory},irq=unix:{interrupt}"
        name = "board-" + self.directory.name.replace("_", "-")
        try:
            sources = ("--memory", memory, "--interrupt", f"unix:{interrupt}")
            self._run("pmac-sim", *sources, "--dpram-startup", "--family", family, *simulator)
            self._until(interrupt.exists, "the simulator")
            self._run("pmacd", "--config", configuration, "--board", board, "--name", name, "--socket", self._socket)
            self._until(lambda: self.pmacctl("send", "I3").returncode == 0, "the board")
            # The system chooses the port.
            self._run("pmac-gateway", "--socket", self._socket, "--listen", "127.0.0.1:0", *gateway)
            self._until(lambda: LISTENING in self.log("pmac-gateway"), "the gateway")
        except BaseException:
            self.close()
            raise
        address = self.log("pmac-gateway").split(LISTENING)[1].split()[0]
        host, port = address.split(":")
        self.address = host, int(port)

    def _run(self, program, *arguments):
        with open(self._log_of(program), "w") as log:
            child = subprocess.Popen([PROGRAMS / program, *arguments], stdin=subprocess.DEVNULL, stdout=log, stderr=log)
        self._children.append(child)

    def _until(self, condition, what):
        def found():
            for child in self._children:
                assert child.poll() is None, f"{child.args[0].name} has ended: {self.log(child.args[0].name)}"
            return condition()

        until(found, what)

    def _log_of(self, program):
        return self.directory / f"{program}.log"

    def log(self, program):
        """What a program has said."""
        return self._log_of(program).read_text()

    def pmacctl(self, *arguments, timeout=120):
        """Runs pmacctl on the board, beside the gateway."""
        command = [PROGRAMS / "pmacctl", "--socket", self._socket, *arguments]
        return subprocess.run(command, capture_output=True, text=True, timeout=timeout, stdin=subprocess.DEVNULL)

    def send(self, line):
        """The lines that the board answers, asked beside the gateway."""
        ran = self.pmacctl("send", line)
        assert ran.returncode == 0, ran.stderr
        return ran.stdout.splitlines()

    def position(self, motor):
        return float(self.send(f"#{motor}P")[0])

    def close(self):
        """Ends the processes, the youngest first."""
        for child in reversed(self._children):
            child.terminate()
            try:
                child.wait(15)
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()
