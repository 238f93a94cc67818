"""What the records have in common: how one is made, and how it says that its value is not live."""

from pathlib import Path

from softioc import alarm, builder

# The time of a record is the board's, not that of its processing.
BOARD_TIME = {"TSE": -2}

# What clients may put to, and who may at all: access.acf.
ACCESS = Path(__file__).with_name("access.acf")


def puts(writable):
    """The fields of a record that clients put to, if the server is ``writable``."""
    return {"ASG": "PUT"} if writable else {}


class Shown:
    """Input records that share one fate: when the board is gone, all of them become INVALID and keep their values."""

    def __init__(self):
        self._records = []

    def add(self, make, name, *arguments, **fields):
        """A new record by ``make``, a function of softioc's builder."""
        record = make(name, *arguments, **BOARD_TIME, **fields)
        self._records.append(record)
        return record

    def invalidate(self, status):
        """The alarm INVALID with ``status``, until the next value."""
        for record in self._records:
            record.set_alarm(alarm.INVALID_ALARM, status)


class Message:
    """A text of what went wrong last, with alarm MAJOR; empty and without alarm when nothing did."""

    def __init__(self, name):
        self._record = builder.longStringIn(name, length=1024)

    def clear(self):
        self._record.set("")

    def tell(self, text):
        self._record.set(shortened(str(text), 1024), severity=alarm.MAJOR_ALARM, alarm=alarm.STATE_ALARM)


def shortened(text, size):
    """``text`` as a record of ``size`` bytes holds it; the end of a cut one says so."""
    encoded = text.encode(errors="replace")
    if len(encoded) < size:
        return text
    return encoded[: size - 20].decode(errors="ignore") + " … (cut)"


def motor_of(report, number):
    """The motor, or None where the board no longer reports it."""
    try:
        return report.motor[number]
    except KeyError:
        return None
