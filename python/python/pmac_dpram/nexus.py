"""Recordings as NeXus files: HDF5 that h5py, silx and nexpy show without explanation.

    python -m pmac_dpram.nexus run.npy run.nxs                 # what pmacctl log or gather has written
    pmacctl log -o - | python -m pmac_dpram.nexus - run.nxs    # every update, as it comes
    python -m pmac_dpram.nexus --live run.nxs                  # the same without pmacctl

Each quantity is a group of its own by time, with a signal a motor: ``entry/following_error/motor1``. What is missing is
in ``entry/gaps``, and is no row of numbers. ``entry/recording`` has the counts, and how it ended. Needs h5py and NumPy.
"""

from __future__ import annotations

import argparse
import logging
import math
import os
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

try:
    import h5py as _h5py  # type: ignore[import-untyped]  # noqa: F401
    import numpy
except ImportError as missing:
    _CURE = f"pmac_dpram.nexus needs h5py and NumPy ({missing}): pip install h5py"
    if __name__ == "__main__":
        sys.exit(_CURE)
    raise ImportError(_CURE) from missing

from . import Board, Snapshot, connect
from ._nexus_file import NexusFile
from ._tables import ROWS, Block, Blocks, Column, Table, read
from .errors import DaemonGone, PmacError, StaleData

__all__ = ["Counts", "record", "write"]

_FIELDS = {
    "commanded_position": ("commanded_position", "count"),
    "actual_position": ("position", "count"),
    "following_error": ("following_error", "count"),
    "velocity": ("velocity", "count/s"),
}
"""What is recorded of each motor: by its name in ``pmacctl log``, the attribute and the unit."""

_log = logging.getLogger("pmac_dpram.nexus")


@dataclass
class Counts:
    """What is in a file, and what is missing in it."""

    samples: int = 0
    """Updates, or gathered samples."""
    missed: int = 0
    """Updates of the board that ``pmacd`` did not read in time."""
    lost: int = 0
    """Updates or samples that nobody took in time."""


class _Signal(Exception):
    """A signal that ends the recording."""


def write(
    path: str | os.PathLike[str], *sources: str | os.PathLike[str], board: Board | None = None
) -> Counts:
    """Writes what ``pmacctl log`` or ``gather`` wrote, CSV or ``.npy``, to the new NeXus file ``path``.

    Several sources are the files of one log, in their order. Of ``board`` the file tells the identity. When the disk is
    full, or at any other error, the file holds what came before, says that it is cut short, and the error is raised.
    """
    counts = Counts()
    table = read(Path(source) for source in sources)
    _write(Path(path), table.columns, table.blocks, board, counts)
    return counts


def record(
    path: str | os.PathLike[str],
    board: Board,
    *,
    seconds: float | None = None,
    motors: Sequence[int] | None = None,
) -> Counts:
    """Writes every update of ``board`` from now on to the new NeXus file ``path``.

    Without ``seconds`` it goes on until it is interrupted. Old data, and a daemon that is gone, are a gap: it goes on
    when updates come again. ``motors`` are all by default. Errors are as in :func:`write`.
    """
    counts = Counts()
    table = _live(board, seconds, motors)
    _write(Path(path), table.columns, table.blocks, board, counts)
    return counts


def _write(path: Path, columns: Sequence[Column], blocks: Iterator[Block], board: Board | None, counts: Counts) -> None:
    names = [column.name for column in columns]
    axis = next((name for name in ("time_s", "servo_cycle") if name in names), None)
    if axis is None:
        raise ValueError(f"no column time_s or servo_cycle: pmacctl log or gather did not write this; it has {names}")
    first = next(blocks, None)
    if first is None:
        raise ValueError("there are no rows")
    start = first[0, names.index("unix_s")] - first[0, names.index(axis)] if "unix_s" in names else None
    kept = [place for place, name in enumerate(names) if name not in ("missed", "lost")]
    file = NexusFile(path, [columns[place] for place in kept], axis, _identity(board), start)
    ended = "complete"
    try:
        before = None
        block: Block | None = first
        while block is not None:
            samples, gaps = _split(names, block, before, file.samples)
            missed, lost = (int(count) for count in gaps[:, 2:].sum(axis=0))
            file.append(samples[:, kept], gaps, missed=counts.missed + missed, lost=counts.lost + lost)
            counts.samples, counts.missed, counts.lost = file.samples, counts.missed + missed, counts.lost + lost
            before = block[-1]
            block = next(blocks, None)
    except BaseException as error:
        ended = f"cut short: {error or type(error).__name__}"
        raise
    finally:
        file.end(ended)
        file.close()


def _identity(board: Board | None) -> dict[str, Any]:
    if board is None:
        return {}
    identity = board.identity()
    told = ("family", "type", "firmware", "servo_period_ns", "servo_report_cycles")
    known = {name: getattr(identity, name) for name in told}
    names = {f"motor{number}_name": name for number, name in board.names().items()}
    return {"name": board.name} | {name: value for name, value in known.items() if value is not None} | names


def _split(names: list[str], block: Block, before: Block | None, index: int) -> tuple[Block, Block]:
    """Samples, and gaps as (samples before it, time, missed, lost). ``before`` is the row before the block."""
    at_s = block[:, names.index("time_s" if "time_s" in names else "servo_cycle")]
    if "sample" in names:
        # Rows of lost samples are missing.
        number = block[:, names.index("sample")]
        lost = numpy.diff(number, prepend=number[0] - 1 if before is None else before[names.index("sample")]) - 1
        at = numpy.flatnonzero(lost)
        return block, numpy.column_stack([index + at, at_s[at], numpy.zeros(len(at)), lost[at]])
    missed, lost = (block[:, names.index(name)] for name in ("missed", "lost"))
    counts = (missed > 0) | (lost > 0)
    # The row of a pause counts nothing, and repeats number and times of the row before. So does the first row behind a
    # full disk, but for its values. That of a pause at the end has times of its own.
    own = block[:, : names.index("missed")]
    first = numpy.full(own.shape[1], numpy.nan) if before is None else before[: own.shape[1]]
    repeats = (own == numpy.vstack([first, own[:-1]])).all(axis=1)
    is_behind_counts = numpy.append(before is not None and before[own.shape[1] :][:2].any(), counts[:-1])
    is_empty = numpy.isnan(block[:, names.index("lost") + 1 :]).all(axis=1)
    is_at_end = is_empty & (own[:, 0] == numpy.append(first[0], own[:-1, 0]))
    is_gap = counts | is_at_end | repeats & (~is_behind_counts | is_empty)
    is_gap[0] |= before is None and is_empty[0]
    samples = index + numpy.cumsum(~is_gap)
    return block[~is_gap], numpy.column_stack([samples, at_s, missed, lost])[is_gap]


def _live(board: Board, seconds: float | None, motors: Sequence[int] | None) -> Table:
    """Every update as ``pmacctl log`` writes it, with the board's servo timer."""
    period_ns = board.identity().servo_period_ns
    axis = Column("time_s" if period_ns else "servo_cycle")
    reported = list(board.snapshot(stale_ok=True).motor)
    chosen = reported if motors is None else list(motors)
    for number in chosen:
        if number not in reported:
            raise ValueError(f"motor {number} is not in the servo report; it has {reported}")
    columns = [Column("update"), axis, *map(Column, ("unix_s", "missed", "lost", "servo_timer"))]
    columns += [Column(f"{number}.{name}", unit) for number in chosen for name, (_, unit) in _FIELDS.items()]

    def blocks() -> Blocks:
        rows: list[list[float]] = []
        try:
            for row in _rows(board, seconds, chosen, period_ns, len(columns)):
                rows.append(row)
                if len(rows) >= ROWS:
                    block, rows = numpy.array(rows), []
                    yield block
        except (Exception, KeyboardInterrupt) as error:
            if rows:
                yield numpy.array(rows)
            # Without a time, a signal is the end that was meant.
            if seconds is not None or not isinstance(error, _Signal):
                raise
        else:
            if rows:
                yield numpy.array(rows)

    return Table(columns, blocks())


def _rows(
    board: Board, seconds: float | None, motors: Sequence[int], period_ns: float | None, width: int
) -> Iterator[list[float]]:
    """A row an update, and a row without values for what is missing before one."""
    updates = board.updates(timeout=0.5)
    end_ns = math.inf if seconds is None else time.monotonic_ns() + seconds * 1e9
    cycle = period_ns / 1e9 if period_ns else 1.0
    before: Snapshot | None = None
    row: list[float] = []
    zero = 0
    is_silent = False
    while True:
        try:
            update = next(updates)
        except (StaleData, DaemonGone) as error:
            if time.monotonic_ns() >= end_ns:
                return
            if not is_silent:
                _log.warning("%s: %s; waiting for updates", board.name, error)
            is_silent = True
            continue
        if update.time_ns >= end_ns:
            return
        timer = update.servo_timer
        if before is None:
            zero = timer
        elif update.gap is not None:
            yield [*row[:3], *update.gap, *[math.nan] * (width - 5)]
            if timer <= before.servo_timer:
                # It began anew. The host's clock says how long ago the update before was.
                passed = round((update.time_ns - before.time_ns) / 1e9 / cycle) if period_ns else 1
                zero = timer - (before.servo_timer - zero) - passed
        is_silent, before = False, update
        row = [update.sequence, (timer - zero) * cycle, update.realtime_ns / 1e9, 0, 0, timer]
        for number in motors:
            motor = update.motor[number]
            values = (getattr(motor, attribute) for attribute, _ in _FIELDS.values())
            row += [math.nan if value is None else value for value in values]
        yield row


class _Interruptible:
    """Blocks of which SIGINT or SIGTERM ends the waiting for the next one, and never the writing of one."""

    def __init__(self, blocks: Blocks, waits_for_producer: bool) -> None:
        """``waits_for_producer``: a first SIGINT has reached the other program of the pipe, too; its last rows come yet."""
        self._blocks = blocks
        self._is_waiting = False
        self._came = ""
        self._patience = int(waits_for_producer)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._note)

    def _note(self, number: int, _frame: object) -> None:
        if number == signal.SIGINT and self._patience > 0:
            self._patience -= 1
            return
        if self._is_waiting:
            self._is_waiting = False
            raise _Signal(signal.Signals(number).name)
        self._came = self._came or signal.Signals(number).name

    def __iter__(self) -> Iterator[Block]:
        return self

    def __next__(self) -> Block:
        if self._came:
            return self._blocks.throw(_Signal(self._came))
        self._is_waiting = True
        try:
            return next(self._blocks)
        finally:
            self._is_waiting = False


def main(arguments: Sequence[str] | None = None) -> int:
    """The command. Its exit status is that of ``pmacctl log``."""
    parser = argparse.ArgumentParser(
        prog="python -m pmac_dpram.nexus",
        description="Writes what pmacctl log or gather wrote, or a live board, to a NeXus file (HDF5).",
    )
    parser.add_argument("source", nargs="*", help=".csv or .npy, of one log; - is CSV on stdin")
    parser.add_argument("output", type=Path, help="the NeXus file, .nxs or .h5; it must not exist yet")
    parser.add_argument("--live", action="store_true", help="every update of the board, instead of a source")
    parser.add_argument("--seconds", type=float, metavar="S", help="with --live: how long; without it until ^C")
    parser.add_argument("--motors", type=_numbers, metavar="N,N", help="with --live: only these motors")
    parser.add_argument("--name", help="the board; of a source: whose identity goes into the file")
    parser.add_argument("--socket", help="the socket of its pmacd")
    options = parser.parse_args(arguments)
    if options.live == bool(options.source):
        parser.error("either name a source, or give --live")
    if not options.live and (options.seconds is not None or options.motors is not None):
        parser.error("--seconds and --motors go with --live")
    counts = Counts()
    try:
        wants_board = options.live or options.name or options.socket
        board = connect(options.name, options.socket) if wants_board else None
        if options.live and board is not None:
            table = _live(board, options.seconds, options.motors)
        else:
            table = read(Path(source) for source in options.source)
        blocks = _Interruptible(table.blocks, "-" in options.source)
        _write(options.output, table.columns, blocks, board, counts)
    except FileExistsError:
        return _refuse(f"{options.output} exists already; it stays as it is", counts)
    except (OSError, ValueError, PmacError, _Signal) as error:
        return _refuse(f"{options.output}: cut short: {error}" if counts.samples else str(error), counts)
    print(_summary(counts))
    return 0


def _numbers(text: str) -> list[int]:
    try:
        return [int(number) for number in text.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no list of motors, such as 1,2") from None


def _summary(counts: Counts) -> str:
    return f"samples={counts.samples} lost={counts.lost} missed={counts.missed}"


def _refuse(reason: str, counts: Counts) -> int:
    if counts.samples:
        print(_summary(counts))
    print(reason, file=sys.stderr)
    return 1


if __name__ == "__main__":
    logging.basicConfig(format="%(message)s")
    sys.exit(main())
