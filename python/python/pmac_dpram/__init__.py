"""Live data and commands of a Delta Tau PMAC motion controller, from ``pmacd``.

    import pmac_dpram

    board = pmac_dpram.connect()
    print(board.snapshot().motor[1].position)  # counts
    print(board.command("#1P"))
    for update in board.updates():  # every servo report
        print(update.sequence, update.motor[1].following_error)
    with board.jog(1, "+"):  # stops at the end of the block, and if this process dies
        ...

Reading needs no right but to read the segment, and cannot disturb the board.
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator, Iterator

from . import _native
from ._native import Gathered, Jog, Motor, Motors, Snapshot, Status, System, Systems
from .errors import DaemonGone, PmacError, StaleData

__all__ = [
    "Board",
    "DaemonGone",
    "Gathered",
    "Jog",
    "Motor",
    "Motors",
    "PmacError",
    "Snapshot",
    "StaleData",
    "Status",
    "System",
    "Systems",
    "Updates",
    "connect",
]


class Updates:
    """Every servo report in turn, none twice. ``for`` and ``async for`` both work.

    ``lost`` counts reports that were overwritten before they were taken here, ``missed`` the board's updates that the
    daemon did not read in time. Both are exact.
    """

    def __init__(self, native: _native.Updates) -> None:
        self._native = native

    def __iter__(self) -> Iterator[Snapshot]:
        return self

    def __next__(self) -> Snapshot:
        return self._native.next()

    def __aiter__(self) -> AsyncIterator[Snapshot]:
        return self

    async def __anext__(self) -> Snapshot:
        update = self._native.take()
        if update is None:
            update = await asyncio.get_running_loop().run_in_executor(None, self._native.next)
        return update

    @property
    def lost(self) -> int:
        """Reports that were overwritten before they were taken here."""
        return self._native.lost

    @property
    def missed(self) -> int:
        """Updates of the board that the daemon did not read in time."""
        return self._native.missed


class Board(_native.Board):
    """A board of a running ``pmacd``; see :func:`connect`."""

    def updates(self, timeout: float = 2.0) -> Updates:
        """Every servo report from now on. After ``timeout`` seconds without one, StaleData or DaemonGone is raised."""
        return Updates(self._updates(timeout))


def connect(name: str | None = None, socket: str | os.PathLike[str] | None = None) -> Board:
    """The board called ``name`` (as ``--name`` of the programs: ``pmac0``), or that of the daemon at ``socket``.

    If both are given, they must be of one board.
    """
    return Board(name, socket)
