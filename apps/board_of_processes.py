"""A simulated board and its daemon as processes of their own, with names and sockets that nobody else has."""

import os
import pathlib
import subprocess
import time

REPOSITORY = pathlib.Path(__file__).parents[1]
PROGRAMS = pathlib.Path(os.environ.get("PMAC_PROGRAMS", REPOSITORY / "target" / "debug"))


def until(condition, what, patience=60):
    """Waits for ``condition`` and returns what it gave."""
    end = time.monotonic() + patience
    while not (found := condition()):
        assert time.monotonic() < end, f"waited in vain for {what}"
        time.sleep(0.02)
    return found


class Board:
    """A board and its daemon. All files are in ``directory``, which is empty and lies in /dev/shm."""

    def __init__(self, directory, *, simulator=(), configuration=""):
        """``simulator``: further options of pmac-sim. ``configuration``: of pmacd, TOML."""
        self.directory = pathlib.Path(directory)
        self.name = "site" + self.directory.name.replace("_", "-")
        self.socket = str(self.directory / "socket")
        self._memory, self._interrupt = self.directory / "dpram", self.directory / "irq"
        self._configuration = self.directory / "pmacd.toml"
        self.configure(configuration)
        self._programs = []
        try:
            interrupt = f"unix:{self._interrupt}"
            self.simulator = self.run(
                PROGRAMS / "pmac-sim", "--memory", self._memory, "--interrupt", interrupt, "--dpram-startup", *simulator
            )
            self.until_up(self.simulator, self._interrupt.exists, "the simulator")
            self.start_daemon()
        except BaseException:
            self.close()
            raise

    def configure(self, configuration):
        """The configuration of the next pmacd."""
        self._configuration.write_text(configuration)

    def start_daemon(self):
        """Starts pmacd on the board and waits for live data of all its functions."""
        board = f"file:{self._memory},irq=unix:{self._interrupt}"
        place = ("--name", self.name, "--socket", self.socket)
        self.daemon = self.run(PROGRAMS / "pmacd", "--config", self._configuration, "--board", board, *place)
        self.until_up(self.daemon, self.is_live, "live data")

    def until_up(self, child, condition, what):
        """Waits for ``condition`` as long as ``child`` runs."""

        def is_up():
            assert child.poll() is None, f"{what}: the program has ended"
            return condition()

        self.until(is_up, what)

    def kill_daemon(self):
        """Kills pmacd, as a crash would."""
        self.daemon.kill()
        self.daemon.wait()

    def run(self, program, *arguments, **options):
        """Starts ``program``; what it says goes to the site's log. :meth:`close` ends it."""
        with open(self.directory / "log", "a") as log:
            child = subprocess.Popen([program, *arguments], stdin=subprocess.DEVNULL, stdout=log, stderr=log, **options)
        self._programs.append(child)
        return child

    def log(self):
        """What all programs have said."""
        return (self.directory / "log").read_text()

    def until(self, condition, what, patience=60):
        """Waits for ``condition``; a wait in vain shows the log."""
        try:
            return until(condition, what, patience)
        except AssertionError as error:
            raise AssertionError(f"{error}; the programs said:\n{self.log()}") from None

    def pmacctl(self, *arguments, timeout=120):
        """Runs pmacctl on the board."""
        command = [PROGRAMS / "pmacctl", "--socket", self.socket, *arguments]
        return subprocess.run(command, capture_output=True, text=True, timeout=timeout, stdin=subprocess.DEVNULL)

    def is_live(self):
        """Whether the board answers lines."""
        return self.pmacctl("send", "I3").returncode == 0

    def close(self):
        """Ends all programs, the youngest first."""
        for child in reversed(self._programs):
            child.terminate()
            try:
                child.wait(15)
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()
