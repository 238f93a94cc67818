"""Samples that the board gathers at servo rate."""

import numpy
import pmac_dpram
from softioc import alarm, builder

from .records import Message, puts

COLUMNS = 8
SAMPLES = 65536


class Gather:
    """``{prefix}GATHER:START`` gathers what ``SOURCES`` names, for ``SECONDS``, each ``PERIOD`` servo cycles, to ``TIME`` and
    ``DATA1`` to ``DATA8``.
    """

    def __init__(self, prefix, acting, writable):
        at, put = f"{prefix}GATHER:", puts(writable)
        self._acting, self._runs = acting, False
        self._sources = builder.longStringOut(f"{at}SOURCES", length=512, initial_value="1.actual_position", **put)
        self._seconds = builder.aOut(f"{at}SECONDS", initial_value=1.0, EGU="s", PREC=3, **put)
        self._period = builder.longOut(f"{at}PERIOD", initial_value=1, EGU="servo cycles", **put)
        builder.Action(f"{at}START", on_update=self._start, **put)
        states = ["Idle", "Gathering", "Done", ("Failed", alarm.MAJOR_ALARM)]
        self._state = builder.mbbIn(f"{at}STATE", *states, initial_value=0)
        self._message = Message(f"{at}MSG")
        self._times = builder.WaveformIn(f"{at}TIME", length=SAMPLES, datatype=float, EGU="s")
        self._columns = [
            builder.WaveformIn(f"{at}DATA{number}", length=SAMPLES, datatype=float) for number in range(1, COLUMNS + 1)
        ]
        self._titles = builder.WaveformIn(f"{at}COLUMNS", length=COLUMNS, datatype="S40")

    async def _start(self, _):
        if self._runs:
            self._message.tell("a gather of this server runs already")
            return
        self._runs = True
        self._state.set(1)
        self._message.clear()
        try:
            gathered = await self._acting.run("gathers", self._gather)
        except (pmac_dpram.PmacError, ValueError) as error:
            self._message.tell(error)
            self._state.set(3)
            return
        finally:
            self._runs = False
        # The rate was measured, so that a few more may come than have room.
        table = numpy.frombuffer(gathered.data).reshape(len(gathered), -1)[:SAMPLES]
        self._times.set(gathered.times[:SAMPLES])
        self._titles.set([title[:39] for title in gathered.columns])
        for index, record in enumerate(self._columns):
            record.set(table[:, index] if index < table.shape[1] else numpy.empty(0))
        self._state.set(2)

    def _gather(self):
        sources, seconds, period = self._sources.get().replace(",", " ").split(), self._seconds.get(), self._period.get()
        if not 1 <= len(sources) <= COLUMNS:
            raise ValueError(f"SOURCES names {len(sources)} sources; 1 to {COLUMNS} are possible")
        if period < 1:
            raise ValueError(f"PERIOD is {period}; it is 1 or more")
        if not seconds > 0:
            raise ValueError(f"SECONDS is {seconds}; it is more than 0")
        wanted = seconds * servo_hz(self._acting.board) / period
        if wanted > SAMPLES:
            raise ValueError(f"SECONDS and PERIOD make {wanted:.0f} samples; {SAMPLES} have room")
        return self._acting.board.gather(sources, seconds, period=period)


def servo_hz(board):
    """How many servo cycles a second the board makes, from its latest reports."""
    reports, _ = board.history(max(board.snapshot(stale_ok=True).sequence - 500, 1))
    if len(reports) < 2:
        raise ValueError("the board has reported too little to know its servo rate; try again")
    first, last = reports[0], reports[-1]
    return (last.servo_timer - first.servo_timer) / (last.time_ns - first.time_ns) * 1e9
