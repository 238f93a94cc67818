"""Live data and commands of a Delta Tau PMAC motion controller, from ``pmacd``.

    import pmac_dpram

    board = pmac_dpram.connect()
    print(board.snapshot().motor[1].position)  # counts
    print(board.command("#1P"))
    for update in board.updates():  # every servo update
        print(update.sequence, update.motor[1].following_error)
    with board.jog(1, "+"):  # stops at the end of the block, and if this process dies
        ...

Reading needs no right but to read the segment, and cannot disturb the board.
"""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import AsyncIterator, Iterable, Iterator, Sequence
from pathlib import Path

from . import _native
from ._native import Columns, Gathered, Identity, Jog, Motor, Motors, Snapshot, Status, Streamed, System, Systems
from .errors import DaemonGone, PmacError, StaleData

__all__ = [
    "Board",
    "Columns",
    "DaemonGone",
    "Gathered",
    "Identity",
    "Jog",
    "Motor",
    "Motors",
    "PmacError",
    "Snapshot",
    "StaleData",
    "Status",
    "Streamed",
    "System",
    "Systems",
    "Updates",
    "connect",
]


class Updates:
    """Every servo update in turn, none twice. ``for`` and ``async for`` both work.

    ``lost`` counts updates that were overwritten before they were taken here, ``missed`` the board's updates that the
    daemon did not read in time. Both are exact.
    """

    def __init__(self, native: _native.Updates) -> None:
        self._native = native
        self._waiting: asyncio.Future[None] | None = None

    def __iter__(self) -> Iterator[Snapshot]:
        return self

    def __next__(self) -> Snapshot:
        return self._native.next()

    def __aiter__(self) -> AsyncIterator[Snapshot]:
        return self

    async def __anext__(self) -> Snapshot:
        began = time.monotonic()
        while (update := self._native.take(waited := time.monotonic() - began)) is None:
            await self._wait(waited)
        return update

    async def _wait(self, waited: float) -> None:
        # Another thread waits, and takes nothing: this task may be cancelled meanwhile. The thread cannot be; who comes next joins
        # it, so that there is never more than one.
        loop = asyncio.get_running_loop()
        waiting = self._waiting
        if waiting is None or waiting.done() or waiting.get_loop() is not loop:
            waiting = self._waiting = loop.run_in_executor(None, self._native.wait, waited)
        await asyncio.shield(waiting)

    def take(self, most: int = 65536) -> list[Snapshot]:
        """The updates that have come already, at most ``most``. Does not wait, and does not mind a daemon that is gone."""
        return self._native.take_all(most)

    def take_columns(self, columns: Sequence[str], most: int = 65536) -> Columns:
        """As :meth:`take`, for ``numpy.frombuffer(found.data, found.dtype)``: no object is made of an update.

        ``columns`` are named as the attributes: ``sequence``, ``time_ns``, ``realtime_ns``, ``servo_timer``; ``1.position``,
        ``1.commanded_position``, ``1.following_error``, ``1.velocity``, ``1.master_position``. What would be None is NaN, and so
        is a motor that is not reported.
        """
        return self._native.take_columns(columns, most)

    @property
    def lost(self) -> int:
        """Updates that were overwritten before they were taken here."""
        return self._native.lost

    @property
    def missed(self) -> int:
        """Updates of the board that the daemon did not read in time."""
        return self._native.missed


_AT_ONCE = 8
"""So many variables one line asks for: its replies have room in every port."""


def _number(text: str) -> float:
    """A value as the board writes it; addresses have a ``$``."""
    if text.startswith("$"):
        return int(text[1:], 16)
    value = float(text)
    return int(value) if value.is_integer() else value


class Board(_native.Board):
    """A board of a running ``pmacd``; see :func:`connect`."""

    def updates(self, timeout: float = 2.0) -> Updates:
        """Every servo update from now on. After ``timeout`` seconds without one, StaleData or DaemonGone is raised."""
        return Updates(self._updates(timeout))

    def read(self, *names: str, timeout: float = 5.0) -> list[float]:
        """The values of variables, as ``board.read("P1", "Q2", "I122")``: anybody may ask for these, engineers for M-variables.

        Q-variables are those of the coordinate system that is addressed.
        """
        values: list[float] = []
        for start in range(0, len(names), _AT_ONCE):
            line = " ".join(names[start : start + _AT_ONCE])
            reply = self._question(line, timeout)
            if len(reply) != len(names[start : start + _AT_ONCE]):
                raise PmacError(f"{line}: the board answers {' '.join(reply)}")
            values.extend(_number(text.strip()) for text in reply)
        return values

    def watch(self, *names: str, period: float = 0.2) -> Iterator[list[float]]:
        """The values of variables (see :meth:`read`), each ``period`` seconds, for ever."""
        due = time.monotonic()
        while True:
            yield self.read(*names)
            due = max(due + period, time.monotonic())
            time.sleep(max(0.0, due - time.monotonic()))

    def rotary(
        self,
        program: str | os.PathLike[str] | Iterable[str],
        *,
        cs: int = 1,
        define: int | None = None,
        run: bool = False,
        clear: bool = False,
        continue_: bool = False,
        timeout: float = 60.0,
    ) -> Streamed:
        """Streams a motion program, constants only, to a rotary buffer; returns when the board has taken all of it.

        ``program`` is the path of a file, or lines. Coordinate system ``cs`` executes it; ``run`` starts it as soon as the
        buffer has its first lines. ``define`` first defines the board's own rotary buffer with so many words. Lines that an
        earlier program has left there are deleted (``clear``) or run first (``continue_``); without either they are an error.
        After ``timeout`` seconds in which the board takes nothing, PmacError is raised. What ends the stream early, this
        process' death too, ends the program.
        """
        if isinstance(program, (str, os.PathLike)):
            name, text = os.fspath(program), Path(program).read_bytes()
        else:
            name, text = "program", "\n".join(program).encode()
        return self._rotary(
            name, text, cs=cs, define=define, run=run, clear=clear, continue_=continue_, timeout=timeout
        )


def connect(name: str | None = None, socket: str | os.PathLike[str] | None = None) -> Board:
    """The board called ``name`` (as ``--name`` of the programs: ``pmac0``), or that of the daemon at ``socket``.

    If both are given, they must be of one board.
    """
    return Board(name, socket)
