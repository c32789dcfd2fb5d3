"""Read lines of numbers in a text, as many as a header declares, or as there are."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import accumulate
from pathlib import Path
from typing import NamedTuple, Protocol, TextIO, TypeVar

import numpy as np

from mlscli.io.clouds.dialect import (
    Dialect,
    has_decimal_comma,
    is_blank,
    is_number,
    number,
)
from mlscli.io.clouds.pointfile import shortfall
from mlscli.io.clouds.rows import LONGEST_ROW, alike, blocks, short
from mlscli.io.files import open_input
from mlscli.io.plausibility.counts import more_than
from mlscli.runtime.arrays import Array, Float64
from mlscli.words import are, some

Item = TypeVar("Item")

ALL = 1 << 62
"""As many rows as there are."""

# Lines by which the others are judged.
_FIRST_ROWS = 50


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
    broken : int
        The number of broken rows.
    strange : int
        The number of lines that do not even begin like a row.
    extra : int
        How many numbers more than declared each row has.
    """

    values: Float64
    fault: str
    broken: int
    strange: int
    extra: int


@contextmanager
def open_lines(path: Path, begin: int) -> Iterator[LineReader]:
    """Open the rows of a text that follow its first `begin` bytes."""
    with open_input(path) as file:
        file.seek(begin)
        with io.TextIOWrapper(file, "utf-8", "replace") as text:
            yield LineReader(text)


def put_together(
    path: Path, declared: NumberLines, beyond: NumberLines, count: int, columns: int
) -> tuple[list[Array], list[str], list[str]]:
    """Return the columns of rows that a header declares and of those beyond, notes and losses.

    Parameters
    ----------
    path : Path
    declared, beyond : NumberLines
        The rows as far as they are declared, and what follows them.
    count : int
        How many are declared.
    columns : int
        How many columns they have.
    """
    values = np.concatenate([each.values.reshape(-1, columns) for each in (declared, beyond)])
    notes, losses = [], []
    if declared.extra:
        notes.append(
            f"{path}: rows have {some(declared.extra, 'number')} more than are declared; the first "
            "ones count"
        )
    if declared.strange and len(declared.values):
        lines = some(declared.strange, "line")
        notes.append(f"{path}: {lines} {are(declared.strange)} no points: {declared.fault}")
    if len(declared.values) < count:
        losses.append(shortfall(path, len(declared.values), count, declared.fault))
    if len(beyond.values):
        notes.append(f"{path}: {more_than(count, count + len(beyond.values))}")
    if beyond.broken:
        losses.append(
            f"{path}: {some(beyond.broken, 'line')} beyond the declared points cannot be read: "
            f"{beyond.fault}"
        )
    return list(values.T), notes, losses


class LineReader:
    """Reads rows in turn; blank lines and comments are skipped.

    A row may have been broken into several lines, all rows in the same way. All rows may also have
    more numbers than declared, unless these look like numbers split at decimal commas.

    Parameters
    ----------
    file : text file
        At the first row.
    """

    def __init__(self, file: TextIO) -> None:
        self._blocks = blocks(file)
        self._waiting: list[str] = []
        self._ends_whole = True
        self._lines = 1

    def skip(self, count: int, width: int | None) -> None:
        """Skip rows, at most as many as there are; see `read`."""
        if count and width != 0:
            left = count * self._shape(width, count).lines
            while left and (lines := self._take(left, 1)):
                left -= len(lines)

    def read(
        self,
        count: int,
        pick: Pick,
        width: int | None,
        *,
        last: bool = False,
        ends: Callable[[Sequence[str]], bool] | None = None,
    ) -> NumberLines:
        """Read up to `count` rows.

        Parameters
        ----------
        count : int
            As the file declares it; may exceed what there is.
        pick : Pick
            Picks the numbers of a row to return.
        width : int or None
            How many numbers a row has; None where rows differ.
        last : bool
            Whether nothing follows, so that lines which do not even begin like a row need not count
            as rows.
        ends : callable, optional
            Returns for the words of a line whether it is no such row, but of what follows.
        """
        shape = self._shape(width, count)
        if ends is not None and shape.lines != self._lines:
            # Lines of what follows, joined, may be as long as a row of these.
            return NumberLines(np.empty((0, 0)), "", 0, 0, 0)
        self._lines = shape.lines
        values: list[Float64] = []
        came = broken = strange = 0
        first_fault = ""
        while came < count and (lines := self._take((count - came) * shape.lines, shape.lines)):
            rows = shape.joined(lines)
            if came + len(rows) < count and not self._waiting and not self._ends_whole:
                # A row that is cut within its last number would look whole.
                rows.pop()
            found = shape.numbers(rows, pick, last, ends)
            values += [found.values] if len(found.values) else []
            if found.fault and not first_fault:
                first_fault = f"the first is {came + found.first + 1:,}, found {found.fault}"
            came += len(found.values) + found.broken
            broken, strange = broken + found.broken, strange + found.strange
            if found.left:
                self._waiting = rows[-found.left :] + self._waiting
                break
        picked = np.concatenate(values) if values else np.empty((0, 0))
        return NumberLines(picked, first_fault, broken, strange, max(0, shape.extra))

    def _shape(self, width: int | None, count: int) -> _Shape:
        """Return how the rows that come next are written, of which there are so many."""
        self._fill(_FIRST_ROWS)
        return _Shape.of(self._waiting[:_FIRST_ROWS], width, count)

    def _take(self, count: int, step: int) -> list[str]:
        """Return the next lines, at most `count`, and whole steps of them; none at the end."""
        self._fill(step)
        count = min(count, len(self._waiting) // step * step or len(self._waiting))
        taken, self._waiting = self._waiting[:count], self._waiting[count:]
        return taken

    def _fill(self, count: int) -> None:
        """Let lines wait, so many if there are."""
        while len(self._waiting) < count:
            _, text = next(self._blocks, (0, ""))
            if not text:
                return
            self._ends_whole = text.endswith("\n")
            self._waiting += [
                line
                for line in text.split("\n")
                if not is_blank(line) and not line.lstrip().startswith("#")
            ]


class _Numbers(NamedTuple):
    """The numbers of some rows.

    Attributes
    ----------
    values, fault, broken, strange
        As of `NumberLines`.
    first : int
        Index of the row that the fault is in.
    left : int
        How many rows at the end are not of these, but of what follows.
    """

    values: Float64
    fault: str = ""
    first: int = 0
    broken: int = 0
    strange: int = 0
    left: int = 0


class _Shape(NamedTuple):
    """How rows are written.

    Attributes
    ----------
    dialect : Dialect
        With the width that rows have.
    width : int or None
        The width that is declared; None where rows differ.
    lines : int
        How many lines a row takes.
    """

    dialect: Dialect
    width: int | None
    lines: int

    @classmethod
    def of(cls, lines: Sequence[str], width: int | None, count: int) -> _Shape:
        """Find out how rows are written, by the first lines; beyond `count` rows these differ."""
        dialect = Dialect.of(lines[:1] if width is None else lines)
        if width is None:
            return cls(dialect, None, 1)
        split = [dialect.fields(line) for line in lines]
        if not dialect.separator:
            widths = list(accumulate(map(len, split)))
            if widths and widths[0] < width and width in widths:
                step = widths.index(width) + 1
                whole = min(count, len(split) // step)
                if widths[step - 1 :: step][:whole] == [width * (k + 1) for k in range(whole)]:
                    return cls(dialect._replace(width=width), width, step)
        # Twice as many are two rows on one line.
        rows = [words for words in split[:count] if words and is_number(words[0])]
        wider = (
            dialect.width > width
            and dialect.width % max(width, 1) > 0
            and all(len(words) == dialect.width for words in rows)
        )
        # Where all numbers are whole, they may be the halves of decimal ones.
        if not (wider and any("." in word for words in split for word in words[:width])):
            dialect = dialect._replace(width=width)
        return cls(dialect, width, 1)

    @property
    def extra(self) -> int:
        """How many numbers more than declared a row has."""
        return 0 if self.width is None else self.dialect.width - self.width

    def joined(self, lines: list[str]) -> list[str]:
        """Return each row on one line."""
        if self.lines == 1:
            return lines
        return [" ".join(lines[k : k + self.lines]) for k in range(0, len(lines), self.lines)]

    def numbers(
        self,
        rows: Sequence[str],
        pick: Pick,
        last: bool,
        ends: Callable[[Sequence[str]], bool] | None,
    ) -> _Numbers:
        """Return the numbers picked of each whole row."""
        # A row has no fewer characters than numbers: a declared width beyond that is not tried.
        if ends is None and self.width is not None and rows and self.width <= len(rows[0]):
            block = alike("\n".join(rows), self.dialect, pick(range(self.width)))
            if block is not None:
                return _Numbers(block)
        kept, fault, first, broken, strange, left = [], "", 0, 0, 0, 0
        for place, row in enumerate(rows):
            words = self.dialect.fields(row) if len(row) <= LONGEST_ROW else []
            if ends is not None and ends(words):
                left = len(rows) - place
                break
            try:
                if self.width is not None and len(words) != self.dialect.width:
                    raise ValueError
                kept.append([number(word) for word in pick(words)])
            except (IndexError, ValueError):
                if not fault:
                    first, fault = place, f"{short(row.strip())}, expected {self._expected(words)}"
                if last and words and not _begins_like_a_row(words[0]):
                    strange += 1
                else:
                    broken += 1
        values = np.array(kept, dtype=np.float64)
        return _Numbers(values, fault, first, broken, strange, left)

    def _expected(self, words: Sequence[str]) -> str:
        expected = "numbers" if self.width is None else f"{self.dialect.width} numbers"
        return expected + " with decimal points" * any(map(has_decimal_comma, words))


def _begins_like_a_row(word: str) -> bool:
    return is_number(word) or has_decimal_comma(word) or not word[:1].isalpha()
