"""Reads what ``pmacctl log`` and ``pmacctl gather`` write, block by block."""

from __future__ import annotations

import csv
import itertools
import sys
from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy

ROWS = 4096
"""The most rows of a block."""

STDIN = Path("-")
"""Stands for CSV on stdin, as ``-`` is CSV on stdout for ``pmacctl``."""

Block = Any
"""Rows by columns: a two-dimensional NumPy array of floats. Whole numbers are at most 2**53."""

Blocks = Generator[Block, None, None]


@dataclass(frozen=True)
class Column:
    """One column of a table."""

    name: str
    unit: str = ""

    @classmethod
    def of(cls, title: str) -> Column:
        """By its title, ``name [unit]``."""
        name, bracket, unit = title.partition(" [")
        return cls(name, unit[:-1]) if bracket and unit.endswith("]") else cls(title)

    @property
    def title(self) -> str:
        """Name and unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


@dataclass(frozen=True)
class Table:
    """Columns, and rows that are read when they are asked for."""

    columns: Sequence[Column]
    blocks: Blocks


def read(paths: Iterable[Path]) -> Table:
    """The table in the files, one behind the other. They have the same columns, as the files of one log do."""
    tables = ((path, _numpy(path) if path.suffix == ".npy" else _csv(path)) for path in paths)
    path, first = next(tables)

    def blocks() -> Blocks:
        yield from first.blocks
        for other, table in tables:
            if table.columns != first.columns:
                raise ValueError(f"{other} has other columns than {path}; only the files of one log go into one file")
            yield from table.blocks

    return Table(first.columns, blocks())


def _numpy(path: Path) -> Table:
    strange = f"{path} is no .npy file with named fields, as pmacctl log and gather write them"
    try:
        rows = numpy.load(path, mmap_mode="r")
    except ValueError as error:
        raise ValueError(f"{strange}: {error}") from None
    names, fields = rows.dtype.names, rows.dtype.fields
    if not names:
        raise ValueError(strange)
    columns = [Column.of(fields[name][2]) if len(fields[name]) > 2 else Column(name) for name in names]

    def blocks() -> Blocks:
        for begin in range(0, len(rows), ROWS):
            some = rows[begin : begin + ROWS]
            yield numpy.column_stack([some[name].astype(float) for name in names])

    return Table(columns, blocks())


def _csv(path: Path) -> Table:
    with ExitStack() as stack:
        file = sys.stdin if path == STDIN else stack.enter_context(open(path, newline=""))
        titles = next(csv.reader(_whole(file)), None)
        if titles is None:
            raise ValueError(f"{path} is empty")
        until_read = stack.pop_all()

    def blocks() -> Blocks:
        with until_read:
            lines = _whole(file)
            while some := list(itertools.islice(lines, ROWS)):
                try:
                    block = numpy.loadtxt(some, delimiter=",", ndmin=2)
                except ValueError as error:
                    raise ValueError(f"{path}: {error}") from None
                if block.shape[1] != len(titles):
                    raise ValueError(f"{path}: rows of {block.shape[1]} values below {len(titles)} names")
                yield block

    return Table([Column.of(title) for title in titles], blocks())


def _whole(lines: Iterable[str]) -> Iterator[str]:
    """Without a last line that was cut off: its last number may lack digits."""
    return (line for line in lines if line.endswith("\n") and line.strip())
