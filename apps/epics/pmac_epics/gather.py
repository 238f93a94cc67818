"""Samples that the board gathers at servo rate."""

import numpy
import pmac_dpram
from softioc import alarm, builder

from .records import Message

COLUMNS = 8
SAMPLES = 65536


class Gather:
    """``{prefix}GATHER:START`` gathers what ``SOURCES`` names, for ``SECONDS``, each ``PERIOD`` servo cycles, to ``TIME`` and
    ``DATA1`` to ``DATA8``.
    """

    def __init__(self, prefix, acting, writable):
        at, out = f"{prefix}GATHER:", {"DISP": 0 if writable else 1}
        self._acting, self._runs = acting, False
        self._sources = builder.longStringOut(f"{at}SOURCES", length=512, initial_value="1.actual_position", **out)
        self._seconds = builder.aOut(f"{at}SECONDS", initial_value=1.0, EGU="s", PREC=3, **out)
        self._period = builder.longOut(f"{at}PERIOD", initial_value=1, EGU="servo cycles", **out)
        builder.Action(f"{at}START", on_update=self._start, **out)
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
        table = numpy.frombuffer(gathered.data).reshape(len(gathered), -1)
        self._times.set(gathered.times)
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
        gathered = self._acting.board.gather(sources, seconds, period=period)
        if len(gathered) > SAMPLES:
            raise ValueError(f"{len(gathered)} samples are too many; at most {SAMPLES} have room")
        return gathered
