"""Read lines of numbers in a text, as many as a header declares."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple, Protocol, TextIO, TypeVar

import numpy as np

from mlscli.io.clouds import columns as lines
from mlscli.runtime.arrays import Float64

Item = TypeVar("Item")


class Pick(Protocol):
    """Picks the wanted items of a row; raises IndexError or ValueError where one is missing."""

    def __call__(self, row: Sequence[Item], /) -> list[Item]:
        """Return the wanted items."""


class NumberLines(NamedTuple):
    """The rows read.

    Attributes
    ----------
    values : float64 (N, columns)
        The numbers picked of each whole row; (0, 0) where there is none.
    fault : str
        What is wrong with the first broken row; empty where there is none.
    """

    values: Float64
    fault: str


@contextmanager
def open_lines(path: Path, begin: int) -> Iterator[LineReader]:
    """Open the rows of a text that follow its first `begin` bytes."""
    with path.open("rb") as file:
        file.seek(begin)
        with io.TextIOWrapper(file, "ascii", "replace") as text:
            yield LineReader(text, path)


class LineReader:
    """Reads rows in turn; blank lines and comments are skipped.

    Parameters
    ----------
    file : text file
        At the first row.
    path : Path
        Its name in errors.
    """

    def __init__(self, file: TextIO, path: Path) -> None:
        self._blocks = lines.blocks(file, path)
        self._waiting: list[str] = []
        self._ends_whole = True

    def skip(self, count: int) -> None:
        """Skip rows, at most as many as there are."""
        while count and (rows := self._take(count)):
            count -= len(rows)

    def read(self, count: int, pick: Pick, width: int | None) -> NumberLines:
        """Read up to `count` rows.

        Parameters
        ----------
        count : int
            As the file declares it; may exceed what there is.
        pick : Pick
            Picks the numbers of a row to return.
        width : int or None
            How many numbers a row has; None where rows differ.
        """
        values: list[Float64] = []
        first_fault, came = "", 0
        while came < count and (rows := self._take(count - came)):
            if came + len(rows) < count and not self._waiting and not self._ends_whole:
                # A row that is cut within its last number would look whole.
                rows.pop()
            block, fault = _numbers(rows, pick, width)
            if len(block):
                values.append(block)
            if fault is not None and not first_fault:
                row, found = fault
                first_fault = f"the first is {came + row + 1:,}, found {found}"
            came += len(rows)
        return NumberLines(np.concatenate(values) if values else np.empty((0, 0)), first_fault)

    def _take(self, count: int) -> list[str]:
        """Return the next rows, at most `count` and at most a block of them; none at the end."""
        while not self._waiting:
            block = next(self._blocks, None)
            if block is None:
                return []
            _, text = block
            self._ends_whole = text.endswith("\n")
            self._waiting = [
                row
                for row in text.split("\n")
                if not lines.is_blank(row) and not row.lstrip().startswith("#")
            ]
        taken, self._waiting = self._waiting[:count], self._waiting[count:]
        return taken


def _numbers(
    rows: Sequence[str], pick: Pick, width: int | None
) -> tuple[Float64, tuple[int, str] | None]:
    """Return the numbers picked of each whole row, and index and fault of the first broken one."""
    # A row has no fewer characters than numbers: a declared width beyond that is not tried.
    if rows and width is not None and width <= len(rows[0]):
        block = lines.numbers(lines.clean("\n".join(rows)), range(width))
        if block is not None:
            return block[:, pick(range(width))], None
    kept, fault = [], None
    for number, row in enumerate(rows):
        words = lines.fields(row)
        try:
            if width is not None and len(words) < width:
                raise ValueError
            kept.append([_number(word) for word in pick(words)])
        except (IndexError, ValueError):
            expected = "numbers" if width is None else f"{width} numbers"
            fault = fault or (number, f"{lines.short(row.strip())}, expected {expected}")
    return np.array(kept, dtype=np.float64), fault


def _number(word: str) -> float:
    """Return the number that a word is; NaN for a missing value."""
    if word and not lines.is_number(word):
        raise ValueError
    return float(word or "nan")
