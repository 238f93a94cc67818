"""The HAL component: what the board reports goes to its pins, what is asked by pins goes to the board."""

import math
import sys

import hal
import pmac_dpram

from .hand import Hand


def tell(message):
    print(f"pmac-hal: {message}", file=sys.stderr, flush=True)


class Component:
    """Pins for all motors of ``snapshot``. What the board does not report has no pin."""

    def __init__(self, name, board, snapshot, connect):
        self._board, self._trouble = board, None
        self._hal = hal.component(name)
        for pin in ("live", "heartbeat"):
            self._hal.newpin(pin, hal.HAL_BIT, hal.HAL_OUT)
        units = board.units()
        self._motors = [
            Motor(self._hal, number, units.get(number, ("counts", 1.0))[1], snapshot.motor[number].status, connect)
            for number in snapshot.motor
        ]
        self._hal.ready()

    def look(self):
        """Brings the pins up to date, and does what they ask."""
        try:
            snapshot, trouble, why = self._board.snapshot(), None, "the board is live"
        except pmac_dpram.PmacError as error:
            snapshot, trouble, why = None, type(error), str(error)
        if trouble != self._trouble:
            tell(why)
            self._trouble = trouble
        for motor in self._motors:
            motor.show(snapshot)
            motor.obey()
        self._hal["live"] = snapshot is not None
        # Last: where it no longer changes, HAL keeps the values of a component that is gone.
        self._hal["heartbeat"] = not self._hal["heartbeat"]

    def close(self):
        """Stops what is held by a pin."""
        for motor in self._motors:
            motor.hand.close()


class Motor:
    """The pins of one motor, whose unit is ``scale`` counts."""

    def __init__(self, pins, number, scale, status, connect):
        self._pins, self._number, self._scale = pins, number, scale
        self.hand = Hand(number, connect, tell)
        self._pin("position", hal.HAL_FLOAT, hal.HAL_OUT)
        self._pin("ferror", hal.HAL_FLOAT, hal.HAL_OUT)
        self._reports_all = status.in_position is not None
        if self._reports_all:
            self._pin("in-position", hal.HAL_BIT, hal.HAL_OUT)
            self._pin("fault", hal.HAL_BIT, hal.HAL_OUT)
        self._pin("jog", hal.HAL_S32, hal.HAL_IN)
        self._pin("jogging", hal.HAL_BIT, hal.HAL_OUT)
        self._pin("abort", hal.HAL_BIT, hal.HAL_IN)

    def _name(self, pin):
        return f"motor.{self._number}.{pin}"

    def _pin(self, pin, kind, direction):
        self._pins.newpin(self._name(pin), kind, direction)

    def _set(self, pin, value):
        self._pins[self._name(pin)] = value

    def show(self, snapshot):
        """What is not known now is no number, not in position, and a fault."""
        motor = None
        if snapshot is not None and self._number in snapshot.motor.keys():
            motor = snapshot.motor[self._number]
        self._set("position", self._length(motor and motor.position))
        self._set("ferror", self._length(motor and motor.following_error))
        self._set("jogging", self.hand.holds)
        if self._reports_all:
            status = motor and motor.status
            self._set("in-position", bool(status and status.in_position))
            self._set("fault", status is None or has_fault(status))

    def _length(self, counts):
        return math.nan if counts is None else counts / self._scale

    def obey(self):
        jog = self._pins[self._name("jog")]
        self.hand.see((jog > 0) - (jog < 0), self._pins[self._name("abort")])


FAULTS = ("amplifier_fault", "i2t_amplifier_fault", "fatal_following_error", "integrated_fatal_following_error")


def has_fault(status):
    """Whether the motor has a fault, or its status is not known."""
    flags = [getattr(status, fault) for fault in FAULTS]
    return None in flags or any(flags)
