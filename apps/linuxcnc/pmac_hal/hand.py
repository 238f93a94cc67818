"""One motor's jog and stop, in a thread of its own: a board that is slow to answer holds up no other motor."""

import threading
import time

import pmac_dpram

# A jog ends when nobody has looked at its pin for so long.
UNSEEN_S = 0.3
CHECK_S = 0.1
# A report tells what the motor does for so long, if no other one comes.
KNOWN_NS = 1_000_000_000
# pmacd stops a jog by itself 0.2 s after the process that holds it.
CLOSE_S = 2.0


class Hand:
    """Jogs motor ``number`` while its pin is not 0, and stops it when ``abort`` rises.

    A jog that has ended by itself, was refused or was aborted begins again only after the pin was 0.
    """

    def __init__(self, number, connect, tell):
        self._number, self._connect, self._tell = number, connect, tell
        # What the pins say, under the lock of `_changed`. `_must_release`: the pin has to be 0 before the next jog.
        self._changed = threading.Condition()
        self._wanted, self._must_release, self._seen = 0, False, time.monotonic()
        self._aborting, self._abort, self._closed = False, False, False
        # What the thread has made of it.
        self._jog, self._direction = None, 0
        self._thread = threading.Thread(target=self._run, name=f"motor {number}", daemon=True)
        self._thread.start()

    @property
    def holds(self):
        """Whether the board jogs the motor for this pin."""
        jog = self._jog
        return jog is not None and jog.is_held

    def see(self, direction, abort):
        """What the pins say now; ``direction`` is -1, 0 or 1. Does not wait."""
        with self._changed:
            self._seen = time.monotonic()
            self._abort |= abort and not self._aborting
            self._aborting = abort
            self._must_release = abort or self._must_release and direction != 0
            self._wanted = 0 if self._must_release else direction
            self._changed.notify()

    def close(self):
        """Ends a jog and the thread."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join(CLOSE_S)

    def _run(self):
        while True:
            with self._changed:
                self._changed.wait_for(self._is_due, CHECK_S if self._jog else None)
                if self._jog and not self._jog.is_held or time.monotonic() - self._seen > UNSEEN_S:
                    self._must_release, self._wanted = True, 0
                wanted = 0 if self._closed else self._wanted
                abort, self._abort, closed = self._abort, False, self._closed
            if wanted != self._direction:
                self._release()
                self._direction = wanted
                if wanted:
                    self._begin("+" if wanted > 0 else "-")
            if abort:
                self._stop()
            if closed:
                return

    def _is_due(self):
        return self._closed or self._abort or self._wanted != self._direction

    def _begin(self, direction):
        try:
            jog = self._connect().jog(self._number, direction)
            self._jog = jog.__enter__()
        except pmac_dpram.PmacError as error:
            self._complain(f"no jog: {error}")

    def _release(self):
        jog, self._jog = self._jog, None
        if jog is None:
            return
        try:
            jog.__exit__(None, None, None)
        except pmac_dpram.PmacError as error:
            self._complain(f"the jog has ended: {error}")

    def _stop(self):
        """Aborts the program that moves the motor; where there is none, stops its jog."""
        try:
            board = self._connect()
            is_open, programs = self._moved_by(board)
            if is_open:
                self._complain("abort: it is in open loop already; nothing was sent, for a stop would close the loop")
            elif programs:
                board.panel("stop", programs)
            else:
                board.panel("jog-stop", [self._number])
        except pmac_dpram.PmacError as error:
            self._complain(f"abort: {error}")

    def _moved_by(self, board):
        """Whether its loop is open, and the coordinate systems whose programs may move it. Where nothing is known, a stop is
        better sent."""
        snapshot = board.snapshot(stale_ok=True)
        if time.monotonic_ns() - snapshot.time_ns > KNOWN_NS or self._number not in snapshot.motor.keys():
            return False, []
        motor = snapshot.motor[self._number]
        programs = [number for number in snapshot.system if snapshot.system[number].status.running_program]
        # Turbo boards do not report whose a motor is.
        if motor.status.assigned_to_coordinate_system is not None:
            programs = [number for number in programs if number == motor.coordinate_system]
        return motor.status.open_loop, programs

    def _complain(self, what):
        self._tell(f"motor {self._number}: {what}")
