"""Every servo report, in blocks: a waveform a column, and one table (NTTable) that has them all.

A client of waveforms may get columns of two blocks, which their times tell. The table is one piece: ``block`` is written
last, so that a table whose ``first`` is not ``block`` was read between two blocks.
"""

import numpy
from softioc import alarm, builder

from .records import Shown

# Reports of one block. More than seven seconds at 2.26 kHz: what a busy machine delays comes in one longer block.
MOST = 16384


class Blocks:
    """Records for the reports of ``updates``; motors have unit ``scale`` counts, by number."""

    def __init__(self, prefix, motors, updates):
        self._updates, self._motors, self._shown = updates, motors, Shown()
        self._table, self._order = f"{prefix}TABLE", 0
        self._labels, self._columns = [], []
        self._first = self._scalar(f"{prefix}FIRST", "first")
        self._update = self._column(f"{prefix}UPDATE", "update", "")
        self._timer = self._column(f"{prefix}TIMER", "timer", "servo cycles")
        self._time = self._column(f"{prefix}TIME", "time", "s")
        self._positions = {number: self._motor(prefix, number, "POS") for number in motors}
        self._errors = {number: self._motor(prefix, number, "FE") for number in motors}
        labels = builder.WaveformIn(f"{prefix}LABELS", numpy.array(self._labels, dtype="S40"))
        self._member(labels, "labels")
        self._lost = self._scalar(f"{prefix}LOST", "lost")
        self._missed = self._scalar(f"{prefix}MISSED", "missed")
        self._block = self._scalar(f"{prefix}BLOCK", "block", trigger="*")
        kinds = ("position", "following_error")
        self._names = [
            *("sequence", "servo_timer", "realtime_ns"),
            *(f"{number}.{kind}" for kind in kinds for number in motors),
        ]
        # What has been taken and is not posted yet, and what was lost by then.
        self._number, self._reports, self._losses = 0, [], 0

    def _member(self, record, field, trigger=""):
        member = {"+type": "plain", "+channel": "VAL", "+putorder": self._order, "+trigger": trigger}
        table = {field: member}
        if self._order == 0:
            table["+id"] = "epics:nt/NTTable:1.0"
            # The table's alarm and time are those of this record.
            table[""] = {"+type": "meta", "+channel": "VAL"}
        self._order += 1
        record.add_info("Q:group", {self._table: table})

    def _scalar(self, name, field, trigger=""):
        record = self._shown.add(builder.int64In, name, initial_value=0)
        self._member(record, field, trigger)
        return record

    def _column(self, name, field, unit):
        record = self._shown.add(builder.WaveformIn, name, length=MOST, datatype=float, EGU=unit)
        self._labels.append(field)
        self._member(record, f"value.{field}")
        return record

    def _motor(self, prefix, number, kind):
        return self._column(f"{prefix}M{number}:{kind}", f"{kind.lower()}{number}", self._motors[number][0])

    def post(self):
        """Posts the reports that have come since the last block, unless that one is not out yet."""
        # Taken in any case: here is room for more than in the segment.
        taken = self._updates.take_columns(self._names, MOST - sum(map(len, self._reports)))
        self._losses += taken.lost
        if len(taken) > 0:
            self._reports.append(numpy.frombuffer(taken.data, taken.dtype))
        if not self._reports or self._block.get_field("VAL") != str(self._number):
            return
        reports, self._reports = numpy.concatenate(self._reports), []
        seconds = reports["realtime_ns"] / 1e9
        good = {"timestamp": seconds[-1]}
        self._number += 1
        self._first.set(self._number, **good)
        self._update.set(reports["sequence"], **good)
        self._timer.set(reports["servo_timer"], **good)
        self._time.set(seconds, **good)
        for number, (_, scale) in self._motors.items():
            self._post(self._positions[number], reports[f"{number}.position"] / scale, good)
            self._post(self._errors[number], reports[f"{number}.following_error"] / scale, good)
        self._lost.set(self._losses, **good)
        self._missed.set(self._updates.missed, **good)
        # Last: this is what sends the table.
        self._block.set(self._number, **good)

    @staticmethod
    def _post(record, values, good):
        if numpy.isnan(values).any():
            record.set(values, severity=alarm.INVALID_ALARM, alarm=alarm.UDF_ALARM, **good)
        else:
            record.set(values, **good)

    def invalidate(self, status):
        self._shown.invalidate(status)
