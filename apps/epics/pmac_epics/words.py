"""The words of the site's own programs."""

import numpy
from softioc import alarm, builder

from .records import Shown


class Word:
    """``{prefix}USER:{name}``: the value of a word of pmacd's configuration, or a waveform of its ``count`` values."""

    def __init__(self, prefix, name, unit, count):
        self._name, self._count, self._shown = name, count, Shown()
        # A point in a record's name begins a field.
        record = f"{prefix}USER:{name.replace('.', ':')}"
        if count == 1:
            self._value = self._shown.add(builder.aIn, record, EGU=unit, PREC=6, MDEL=-1)
        else:
            self._value = self._shown.add(builder.WaveformIn, record, length=count, datatype=float, EGU=unit)

    def show(self, snapshot):
        """Posts the word of a snapshot. One that is old, or was not whole, is INVALID and keeps its value."""
        value = snapshot.user.get(self._name)
        if value is None:
            self.invalidate(alarm.UDF_ALARM)
            return
        self._value.set(value if self._count == 1 else numpy.array(value, float), timestamp=snapshot.realtime_ns / 1e9)

    def invalidate(self, status):
        self._shown.invalidate(status)
