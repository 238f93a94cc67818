"""The scalar records of one motor, and its target."""

import asyncio
import math
import threading
import time

import pmac_dpram
from softioc import alarm, builder

from .records import Message, Shown, motor_of, puts

# A move that was accepted shows in the reports by then. Before, "done" would be that of the time before it.
SETTLING_S = 0.25

# So long a move waits for a report that tells whether the loop is closed.
REPORT_S = 2.0

# A report tells what a motor does for so long, if no other one comes.
KNOWN_NS = 1_000_000_000

STATES = [
    ("Disabled", alarm.MINOR_ALARM),
    ("Open loop", alarm.MINOR_ALARM),
    ("Moving", alarm.NO_ALARM),
    ("In position", alarm.NO_ALARM),
    ("Not in position", alarm.NO_ALARM),
    ("Limit", alarm.MINOR_ALARM),
    ("Following error", alarm.MAJOR_ALARM),
    ("Amplifier fault", alarm.MAJOR_ALARM),
    ("Standing", alarm.NO_ALARM),
]
(DISABLED, OPEN_LOOP, MOVING, IN_POSITION, NOT_IN_POSITION, LIMIT, FOLLOWING_ERROR, AMPLIFIER_FAULT, STANDING) = range(
    len(STATES)
)


def state(status, has_background):
    """The most important of what the flags say, an index of STATES; None where a status word is missing.

    Classic boards report the second word with their background data; Turbo boards have none in the DPRAM.
    """
    if status.motor_activated is None or not has_background:
        return None
    if status.amplifier_fault:
        return AMPLIFIER_FAULT
    if status.fatal_following_error:
        return FOLLOWING_ERROR
    if not status.motor_activated:
        return DISABLED
    if status.open_loop:
        return OPEN_LOOP
    if not status.desired_velocity_zero:
        return MOVING
    if status.positive_limit_set or status.negative_limit_set or status.stopped_on_position_limit:
        return LIMIT
    if status.in_position is None:
        return STANDING
    return IN_POSITION if status.in_position else NOT_IN_POSITION


class Motor:
    """Records ``{prefix}M{number}:…`` of a motor. Its unit is ``unit``, one of which is ``scale`` counts."""

    def __init__(self, prefix, number, name, unit, scale, acting, writable):
        self.number, self._scale, self._acting = number, scale, acting
        self._board = acting.board
        at = f"{prefix}M{number}:"
        places = min(max(math.ceil(math.log10(abs(scale) * 10)), 0), 12)
        fields = {"EGU": unit, "PREC": places, "DESC": name}
        self._shown = Shown()
        # Each report is posted, also one without a change: a client sees that the board lives.
        always = {"MDEL": -1, **fields}
        self._readback = self._shown.add(builder.aIn, f"{at}RBV", **always)
        self._error = self._shown.add(builder.aIn, f"{at}FERR", **always)
        self._state = self._shown.add(builder.mbbIn, f"{at}STAT", *STATES, DESC=name)
        self._flags = self._shown.add(builder.longStringIn, f"{at}FLAGS", length=512)
        self._done = self._shown.add(builder.boolIn, f"{at}DMOV", "Moving", "Done", DESC=name)
        self._message = Message(f"{at}MSG")
        put = puts(writable)
        self._target = builder.aOut(
            f"{at}VAL", always_update=True, blocking=True, on_update=self._move, **fields, **put
        )
        builder.Action(f"{at}STOP", on_update=self._stop, DESC=name, **put)
        # Moves that were asked for before a stop are not begun after it.
        self._stops = 0
        # The stop that waits for its turn.
        self._next_stop = None
        # Reports of before that time (monotonic) do not tell that the latest move is done.
        self._done_from = 0.0
        self._done_lock = threading.Lock()
        # Whether DMOV tells what is so now.
        self._is_known = False

    def preset(self, motor):
        """The target that is shown before anybody has set one: where the motor has been told to be, or else where it is."""
        told = motor.commanded_position if motor.commanded_position is not None else motor.position
        if told is not None:
            self._target.set(told / self._scale)

    def show(self, motor, snapshot):
        """Posts ``motor`` of a snapshot."""
        status, seconds = motor.status, snapshot.realtime_ns / 1e9
        found = state(status, len(snapshot.system) > 0)
        severity = STATES[found][1] if found in (LIMIT, FOLLOWING_ERROR, AMPLIFIER_FAULT) else alarm.NO_ALARM
        flag = {"severity": severity, "alarm": alarm.STATE_ALARM if severity else alarm.NO_ALARM, "timestamp": seconds}
        for record, counts in ((self._readback, motor.position), (self._error, motor.following_error)):
            if counts is None:
                record.set_alarm(alarm.INVALID_ALARM, alarm.UDF_ALARM)
            else:
                record.set(counts / self._scale, **flag)
        if found is None:
            with self._done_lock:
                self._is_known = False
                for record in (self._state, self._flags, self._done):
                    record.set_alarm(alarm.INVALID_ALARM, alarm.UDF_ALARM)
            return
        self._state.set(found, timestamp=seconds)
        self._flags.set(" ".join(status.names()), timestamp=seconds)
        stands = found != MOVING and found != NOT_IN_POSITION
        with self._done_lock:
            self._is_known = True
            self._done.set(stands and snapshot.time_ns / 1e9 >= self._done_from, timestamp=seconds)

    def invalidate(self, status):
        with self._done_lock:
            self._is_known = False
            self._shown.invalidate(status)

    async def _move(self, target):
        stops = self._stops

        def move():
            # A report that has come since, though a busy machine may look at it late.
            has_come = self._board.wait(REPORT_S)
            is_open = self._is_open_loop(self._board.snapshot(stale_ok=has_come))
            if stops != self._stops:
                raise pmac_dpram.PmacError(f"motor {self.number} was stopped before the move to {target} began")
            if is_open:
                raise pmac_dpram.PmacError(
                    f"motor {self.number} is in open loop: the move to {target} was not sent, it would close the loop; "
                    f"#{self.number}J/ closes it where the motor is"
                )
            self._board.jog_to(self.number, target * self._scale)
            if stops != self._stops:
                # The stop may have overtaken it on its way to the board.
                self._halt()

        self._message.clear()
        if not math.isfinite(target):
            self._message.tell(f"{target} is no position")
            return
        with self._done_lock:
            self._done_from = math.inf
            # What is not known stays so.
            if self._is_known:
                self._done.set(False, timestamp=time.time())
        try:
            await self._acting.run("moves", move)
        except pmac_dpram.PmacError as error:
            self._message.tell(error)
        finally:
            self._done_from = time.monotonic() + SETTLING_S

    def _is_open_loop(self, snapshot):
        reported = motor_of(snapshot, self.number)
        return reported is not None and reported.status.open_loop

    def _halt(self):
        # J/ closes the loop of a motor that is killed. A stop must not do that. Where nothing is known, a stop is better sent.
        snapshot = self._acting.stopping.snapshot(stale_ok=True)
        if time.monotonic_ns() - snapshot.time_ns <= KNOWN_NS and self._is_open_loop(snapshot):
            raise pmac_dpram.PmacError(
                f"motor {self.number} is in open loop: J/ was not sent, it would close the loop; "
                f"#{self.number}K kills the motor"
            )
        self._acting.stopping.command(f"#{self.number}J/")

    async def _stop(self, _):
        self._stops += 1

        def halt():
            # Who asks from now on gets a stop of his own.
            self._next_stop = None
            self._halt()

        # One that waits for its turn is sent after this one was asked for, too. So a stop of another motor waits for one of each
        # motor, not for a crowd.
        stop = self._next_stop
        if stop is None or stop.done():
            self._message.clear()
            stop = self._next_stop = asyncio.ensure_future(self._acting.run("stops", halt))
        try:
            await asyncio.shield(stop)
        except pmac_dpram.PmacError as error:
            self._message.tell(f"STOP: {error}")


class Acting:
    """Carries out what clients put, beside the reading. Of one kind one after the other; a stop waits for no other kind."""

    def __init__(self, connect, pools):
        self.board, self.stopping, self._pools = connect(), connect(), pools

    async def run(self, kind, action):
        """What ``action`` returns, which may wait."""
        return await asyncio.get_running_loop().run_in_executor(self._pools[kind], action)
