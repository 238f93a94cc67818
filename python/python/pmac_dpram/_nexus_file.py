"""A NeXus file that grows block by block, and can be read whatever ends it.

It is written in HDF5's single-writer multiple-reader mode: others may read along (``h5py.File(path, swmr=True)``), and what
has been flushed outlives a process that is killed. Room on the disk is taken before each block, so that a full disk finds
the file whole.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import h5py  # type: ignore[import-untyped]
import numpy

from ._tables import ROWS, Block, Column

GAP_FIELDS = {
    "index": "samples before it",
    "time": "time of the sample beside it",
    "missed": "updates that pmacd did not read in time",
    "lost": "updates or samples that nobody took in time",
}
"""What is kept of each gap."""

_SPARE = 1 << 20
"""Bytes taken beyond the data, so that a file on a full disk can be ended."""

_GAPS = 512
"""Gaps of a chunk. They are not compressed, so that a chunk stays in its place while it grows."""

_UNITS = {"msec": "ms"}
_OWN_UNITS = {"time_s": "s", "unix_s": "s", "servo_cycle": "servo cycles"}
_WHOLE = frozenset({"update", "sample", "servo_timer", "servo_cycle"})
_TEXT = 200


class NexusFile:
    """One recording under way. After an error it holds the blocks before it."""

    def __init__(
        self, path: Path, columns: Sequence[Column], axis: str, about: Mapping[str, Any], start: float | None
    ) -> None:
        """The other columns go by the one called ``axis``. ``about`` tells of the board; ``start`` is the Unix time at time 0."""
        self._path = path
        path.touch(exist_ok=False)
        try:
            self._take_room(0)
            self._file = _open(path, "w", libver="latest")
            self._lay_out(columns, axis, about, start)
            self._file.flush()
            self._file.swmr_mode = True
        except BaseException:
            path.unlink()
            raise

    def _lay_out(self, columns: Sequence[Column], axis: str, about: Mapping[str, Any], start: float | None) -> None:
        self._file.attrs.update(NX_class="NXroot", default="entry", creator="pmac_dpram", file_name=self._path.name)
        self._entry = _group(self._file, "entry", "NXentry")
        self._entry["title"] = self._path.stem
        self._entry["program_name"] = "pmac_dpram"
        instrument = _group(self._entry, "instrument", "NXinstrument")
        instrument["name"] = about.get("name", "PMAC")
        board = _group(instrument, "board", "NXcollection")
        for name, value in about.items():
            board[name] = value
        recording = _group(self._entry, "recording", "NXcollection")
        self._totals = {name: recording.create_dataset(name, data=0) for name in ("samples", "missed", "lost")}
        self._ended = recording.create_dataset("ended", dtype=f"S{_TEXT}", shape=())
        self.end("cut short without notice, or still being written")

        time = _series(self._entry, "time", "f8", long_name="time (s)" if axis == "time_s" else axis)
        if start is not None:
            self._entry["start_time"] = time.attrs["start"] = _iso(start)
        self._rest = numpy.empty((0, len(columns)))
        self._columns = []
        for column in columns:
            if column.name == axis:
                time.attrs["units"] = _unit(column)
                self._columns.append(time)
            else:
                self._columns.append(self._signal(column, time))
        self._entry.attrs["default"] = _place(_chief(columns, axis).name)[0]

        gaps = _group(self._entry, "gaps", "NXdata", signal="missed", auxiliary_signals=["lost"], axes=["time"])
        self._gaps = [
            gaps.create_dataset(name, (0,), "f8" if name == "time" else "i8", maxshape=(None,), chunks=(_GAPS,))
            for name in GAP_FIELDS
        ]
        for series, text in zip(self._gaps, GAP_FIELDS.values(), strict=True):
            series.attrs["long_name"] = text
        gaps["time"].attrs["units"] = time.attrs["units"]

    def _signal(self, column: Column, time: Any) -> Any:
        """The dataset of a column, in the group of its quantity."""
        quantity, name = _place(column.name)
        if quantity in self._entry:
            group = self._entry[quantity]
            if name in group:
                raise ValueError(f"{column.name}: another column has its name already")
            group.attrs["auxiliary_signals"] = [*group.attrs.get("auxiliary_signals", ()), name]
        else:
            group = _group(self._entry, quantity, "NXdata", signal=name, axes=["time"], time_indices=0, title=quantity)
            group["time"] = time
        kind = "i8" if column.name in _WHOLE else "f8"
        return _series(group, name, kind, units=_unit(column), long_name=column.title)

    @property
    def samples(self) -> int:
        """How many it has been given."""
        return len(self._columns[0]) + len(self._rest)

    def append(self, samples: Block, gaps: Block, **totals: int) -> None:
        """Takes samples, gaps in the order of :data:`GAP_FIELDS`, and the totals ``missed`` and ``lost``.

        Without room for all of them it takes none: OSError.
        """
        rest = numpy.concatenate([self._rest, samples])
        self._take_room(self._file.id.get_filesize() + rest.nbytes + gaps.nbytes)
        # What is compressed is written once: it would leave holes in the file.
        whole = len(rest) // ROWS * ROWS
        self._write(rest[:whole], gaps, totals)
        self._rest = rest[whole:]

    def _write(self, samples: Block, gaps: Block, totals: Mapping[str, int]) -> None:
        for series, values in zip([*self._columns, *self._gaps], [*samples.T, *gaps.T], strict=True):
            before = len(series)
            series.resize(before + len(values), axis=0)
            series[before:] = values
        # Data before the totals: whoever is killed between has not promised too much.
        self._file.flush()
        for name, total in {"samples": len(self._columns[0]), **totals}.items():
            self._totals[name][()] = total
        self._file.flush()

    def end(self, how: str) -> None:
        """Notes how it ended."""
        self._ended[()] = numpy.bytes_(how.encode()[:_TEXT])

    def close(self) -> None:
        """Writes the rest, closes the file, and gives back what room it did not use."""
        self._write(self._rest, numpy.empty((0, len(self._gaps))), {})
        self._file.close()
        _open(self._path, "r+").close()

    def _take_room(self, size: int) -> None:
        with open(self._path, "r+b") as file:
            os.posix_fallocate(file.fileno(), 0, size + _SPARE)


def _open(path: Path, mode: str, **options: Any) -> Any:
    """The file without HDF5's lock: it is this process's alone, and a reader that looks in while it begins would refuse it."""
    return h5py.File(path, mode, locking=False, **options)


def _group(parent: Any, name: str, kind: str, **attributes: Any) -> Any:
    group = parent.create_group(name)
    group.attrs.update(NX_class=kind, **attributes)
    return group


def _series(group: Any, name: str, kind: str, **attributes: Any) -> Any:
    packed = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
    series = group.create_dataset(name, (0,), kind, maxshape=(None,), chunks=(ROWS,), **packed)
    series.attrs.update({name: value for name, value in attributes.items() if value != ""})
    return series


def _place(name: str) -> tuple[str, str]:
    """Group and dataset of a column: ``1.velocity`` is ``velocity/motor1``, ``Y:$C003`` is ``Y_C003/Y_C003``."""
    where, dot, quantity = name.rpartition(".")
    where = f"motor{where}" if where.isdigit() else where
    safe = re.sub(r"\W+", "_", quantity, flags=re.ASCII).strip("_")
    return safe, (re.sub(r"\W+", "_", where, flags=re.ASCII) if dot else safe)


def _chief(columns: Sequence[Column], axis: str) -> Column:
    """What is shown first: a value with a unit."""
    others = [column for column in columns if column.name != axis]
    return next((column for column in others if column.unit), others[-1])


def _unit(column: Column) -> str:
    return _OWN_UNITS.get(column.name) or _UNITS.get(column.unit, column.unit)


def _iso(unix_s: float) -> str:
    return datetime.fromtimestamp(unix_s, UTC).isoformat()
