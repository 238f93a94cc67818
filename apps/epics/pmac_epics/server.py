"""All records of a board, and the thread that keeps them live."""

import concurrent.futures
import logging
import os
import threading
import time

import pmac_dpram
from softioc import alarm, builder

from .blocks import Blocks
from .commands import Commands
from .gather import Gather
from .motors import Acting, Motor
from .records import motor_of, shortened
from .words import Word

log = logging.getLogger(__name__)

# Blocks at 20 Hz; scalars each second time.
TICK_S = 0.05
SCALARS_EACH = 2

LIVE, STALE, GONE = range(3)


class OtherUnits(pmac_dpram.StaleData):
    """Positions would be shown in units that they do not have."""


class Server:
    """The records of the board that ``connect`` gives, made before iocInit; without live data an exception and no record."""

    def __init__(self, connect, prefix, writable):
        self._board = connect()
        snapshot, updates = self._board.snapshot(), self._board.updates()
        names, self._units = self._board.names(), self._board.units()
        kinds = ("moves", "stops", "commands", "gathers")
        acting = Acting(connect, {kind: concurrent.futures.ThreadPoolExecutor(1, kind) for kind in kinds})
        # From here on nothing asks the board.
        self.name = self._board.name
        self.prefix = prefix = prefix or f"{self.name.upper()}:"
        found = {number: self._units.get(number, ("counts", 1.0)) for number in snapshot.motor}
        self._motors = [
            Motor(prefix, number, names.get(number, f"motor {number}"), unit, scale, acting, writable)
            for number, (unit, scale) in found.items()
        ]
        for motor in self._motors:
            motor.preset(snapshot.motor[motor.number])
        self._words = [Word(prefix, name, unit, count) for name, (unit, count) in self._board.words().items()]
        self._blocks = Blocks(prefix, found, updates)
        states = ["Live", ("Stale", alarm.INVALID_ALARM), ("Gone", alarm.INVALID_ALARM)]
        self._state = builder.mbbIn(f"{prefix}CONN", *states, initial_value=GONE)
        self._why = builder.longStringIn(f"{prefix}WHY", length=512)
        Commands(prefix, acting, writable)
        Gather(prefix, acting, writable)
        self._shows = self._told = None
        self._end = threading.Event()

    def follow(self):
        """Keeps the records live until :meth:`close`; to be called after iocInit."""
        threading.Thread(target=self._run, name="reading", daemon=True).start()

    def close(self):
        self._end.set()

    def _run(self):
        try:
            due, count = time.monotonic(), 0
            while not self._end.wait(max(0.0, due - time.monotonic())):
                # After a pause of the machine there is nothing to catch up with: the next block is longer. And the last one
                # gets the time to be sent before the next changes its columns.
                due = max(due, time.monotonic() - TICK_S / 2) + TICK_S
                try:
                    if count % SCALARS_EACH == 0:
                        self._scalars()
                    if self._shows == LIVE:
                        self._blocks.post()
                except pmac_dpram.PmacError as error:
                    self._down(GONE if isinstance(error, pmac_dpram.DaemonGone) else STALE, error)
                count += 1
        except BaseException:
            # Records that nobody updates must not be served as live.
            log.exception("the reading of the board has ended")
            os._exit(1)

    def _scalars(self):
        snapshot = self._board.snapshot()
        if self._board.units() != self._units:
            raise OtherUnits("pmacd has other units of motors than when this server began; start it again")
        if self._shows != LIVE:
            self._told = None
            self._say(LIVE, "")
        for motor in self._motors:
            reported = motor_of(snapshot, motor.number)
            if reported is None:
                motor.invalidate(alarm.UDF_ALARM)
            else:
                motor.show(reported, snapshot)
        for word in self._words:
            word.show(snapshot)

    def _down(self, state, error):
        """Makes everything INVALID, once, until it is live or down in another way."""
        if self._told is type(error):
            return
        self._told = type(error)
        status = alarm.COMM_ALARM if state == GONE else alarm.TIMEOUT_ALARM
        for shown in [*self._motors, *self._words, self._blocks]:
            shown.invalidate(status)
        self._say(state, str(error))

    def _say(self, state, why):
        if state == LIVE:
            log.info("the board is live")
        else:
            log.warning(why)
        self._shows = state
        self._state.set(state)
        self._why.set(shortened(why, 512))
