"""Read the rows of a text as numbers, a block of lines at a time.

A block whose rows are all alike, of simple numbers, is parsed by a kernel (`decimals`). Where it
finds another number, numpy parses the block, and counting its separators shows that rows are alike;
of any other block the lines are taken one by one.
"""

from __future__ import annotations

import io
import math
import re
from collections.abc import Iterator, Sequence
from typing import NamedTuple, TextIO

import numpy as np

from mlscli.io.clouds.columns import Layout
from mlscli.io.clouds.dialect import (
    MARKS,
    Dialect,
    has_decimal_comma,
    is_blank,
    is_comment,
    number,
)
from mlscli.runtime.arrays import Bool, Float64, Int64
from mlscli.words import some

BLOCK_CHARACTERS = 1 << 22
"""Characters read at a time."""

LONGEST_ROW = 1 << 16
"""Characters; what is longer is no row of numbers."""

LONGEST_LINE = 1 << 26
"""Characters of a line that are kept; the rest of it is taken for another line."""

_MOST_LINES = 8
"""A row stands on so many lines at most."""

_BARRED = re.compile(r"^[ \t]*\|", re.MULTILINE)
_QUOTED = re.compile(r'"(?:[^"]|"")*+"')

_NEWLINE, _BLANK = 10, 32

_LARGE = 1 << 20
"""Characters; numpy parses fewer in less time than it takes to load the kernel."""


class Rows(NamedTuple):
    """The rows of a block.

    Attributes
    ----------
    values : float64 (N, columns)
        The wanted numbers of each.
    after_blank : bool (N,)
        Whether a blank line precedes it.
    ends_blank : bool
        Whether a blank line ends the block.
    odd : int
        How many have more or fewer fields than the dialect's width.
    """

    values: Float64
    after_blank: Bool
    ends_blank: bool
    odd: int


class BrokenRowError(Exception):
    """A row does not hold the numbers that are wanted.

    Parameters
    ----------
    line : int
        Index of its line in the block.
    fault : str
        What was found and expected there.
    name : str
        The column that is at fault; empty where it is the whole line.
    is_written_so : bool
        Whether it shows that the text is written in another way than was thought.
    """

    def __init__(
        self, line: int, fault: str, name: str = "", *, is_written_so: bool = False
    ) -> None:
        super().__init__(fault)
        self.line = line
        self.fault = fault
        self.name = name
        self.is_written_so = is_written_so


def blocks(file: TextIO, line: int = 1, separator: str = "") -> Iterator[tuple[int, str]]:
    """Yield whole lines a few megabytes at a time.

    Parameters
    ----------
    file : text file
    line : int
        Number of the line at which it stands.
    separator : str
        Between fields whose quotes may protect the end of a line; such rows come whole.

    Yields
    ------
    line : int
        Number of the first line.
    text : str
    """
    while text := file.read(BLOCK_CHARACTERS):
        if not text.endswith("\n"):
            text += file.readline(LONGEST_LINE)
        for _ in range(_MOST_LINES * _MOST_LINES):
            more = _may_go_on(text, separator) and file.readline(LONGEST_LINE)
            if not more:
                break
            text += more
        yield line, text
        line += text.count("\n")


def _may_go_on(text: str, separator: str) -> bool:
    """Return whether one of the last lines begins a row that goes on behind the text."""
    if not separator or '"' not in text[-LONGEST_ROW:] or not text.endswith("\n"):
        return False
    lines = text[-LONGEST_ROW:].removesuffix("\n").split("\n")[1 - _MOST_LINES :]
    return any(_is_open(" ".join(lines[first:]), separator) for first in range(len(lines)))


def parse(
    text: str,
    dialect: Dialect,
    layout: Layout,
    after_blank: bool,
    broken: list[BrokenRowError] | None = None,
) -> Rows:
    """Parse the rows of a block.

    Parameters
    ----------
    text : str
        Whole lines.
    dialect : Dialect
    layout : Layout
        The columns that are wanted.
    after_blank : bool
        Whether a blank line precedes the block.
    broken : list of BrokenRowError, optional
        Takes the rows that are broken, which are then left out.

    Raises
    ------
    BrokenRowError
        A row lacks a wanted column or has too many, or holds no number there; with `broken`, only
        where it shows that the text is written in another way, or that the fourth column, taken
        as the keyframe, is none.
    """
    values = alike(text, dialect, list(layout.places.values()))
    if values is not None and not _lacks_keyframes(values, list(layout.places)):
        starts = np.zeros(len(values), dtype=np.bool_)
        starts[:1] = after_blank
        return Rows(values, starts, ends_blank=False, odd=0)
    points: list[list[float]] = []
    starting: list[bool] = []
    odd = 0
    for index, line in _records(text.removesuffix("\n").split("\n"), dialect):
        words = dialect.fields(line) if len(line) <= LONGEST_ROW else [""]
        if not words or (len(line) > LONGEST_ROW and is_comment(line)):
            after_blank = after_blank or is_blank(line)
            continue
        try:
            points.append(_picked(words, layout, index, line))
        except BrokenRowError as fault:
            is_guess = layout.guessed and fault.name == "keyframe"
            if broken is None or fault.is_written_so or is_guess:
                raise
            broken.append(fault)
            continue
        starting.append(after_blank)
        after_blank = False
        odd += len(words) != dialect.width
    picked = np.array(points, dtype=np.float64).reshape(-1, len(layout.places))
    return Rows(picked, np.array(starting, dtype=np.bool_), after_blank, odd)


def _records(lines: Sequence[str], dialect: Dialect) -> Iterator[tuple[int, str]]:
    """Yield the lines and their indices; those of one row, as quotes tell, are joined."""
    index = 0
    while index < len(lines):
        line, count = lines[index], 1
        if dialect.separator and line.count('"') % 2 and _is_open(line, dialect.separator):
            line, count = _joined(lines[index : index + _MOST_LINES], dialect)
        yield index, line
        index += count


def _joined(lines: Sequence[str], dialect: Dialect) -> tuple[str, int]:
    """Return the row that begins with the first of the lines, and how many it stands on.

    A single mark, as for inches, joins nothing: a row that goes on has all its fields in the end,
    and not all of its lines are rows by themselves.
    """
    whole, are_rows = lines[0], len(dialect.fields(lines[0])) == dialect.width
    for count, line in enumerate(lines[1:], start=2):
        whole = f"{whole} {line}"
        are_rows &= len(dialect.fields(line)) == dialect.width
        if len(whole) > LONGEST_ROW:
            break
        if not _is_open(whole, dialect.separator):
            if not are_rows and len(dialect.fields(whole)) == dialect.width:
                return whole, count
            break
    return lines[0], 1


def _is_open(line: str, separator: str) -> bool:
    """Return whether a line ends within quotes: those that a field begins with."""
    at = 0
    while True:
        field = line[at:].lstrip(" ")
        if field.startswith('"'):
            # Two marks within stand for one.
            closed = _QUOTED.match(field)
            if closed is None:
                return True
            at = len(line) - len(field) + closed.end()
        at = line.find(separator, at) + 1
        if not at:
            return False


def alike(text: str, dialect: Dialect, places: Sequence[int]) -> Float64 | None:
    """Parse rows that all have the dialect's width.

    Parameters
    ----------
    text : str
        Whole lines.
    dialect : Dialect
    places : sequence of int
        Indices of the columns to return, in this order.

    Returns
    -------
    float64 (N, columns) or None
        None where a line is anything but a row of that many fields, with numbers at these places.
    """
    if not text.isascii() or any(mark in text for mark in MARKS):
        return None
    if max(places) >= dialect.width or (dialect.separator == "|" and _BARRED.search(text)):
        return None
    first = text.partition("\n")[0]
    each = first.count(dialect.separator) if dialect.separator else dialect.width
    if dialect.separator and len(dialect.fields(first)) != dialect.width:
        return None
    values = _decimals(text, dialect, places, each)
    return _by_numpy(text, dialect, places, each) if values is None else values


def _decimals(text: str, dialect: Dialect, places: Sequence[int], each: int) -> Float64 | None:
    """Parse alike rows of ASCII whose numbers are simple, in a tenth of numpy's time; else None.

    See `alike`; `each` is how many separators stand in a row, or how many words.
    """
    if len(text) < _LARGE or len(set(places)) < len(places):
        return None
    if dialect.separator and each != dialect.width - 1:
        return None
    from mlscli.io.clouds.decimals import read_rows

    data = np.frombuffer((text if text.endswith("\n") else text + "\n").encode(), dtype=np.uint8)
    columns = np.full(dialect.width, -1, dtype=np.int64)
    columns[list(places)] = np.arange(len(places))
    values = np.empty((np.count_nonzero(data == _NEWLINE), len(places)))
    rows = read_rows(data, ord(dialect.separator or "\0"), columns, values)
    return None if rows < 0 else values[:rows]


def _by_numpy(text: str, dialect: Dialect, places: Sequence[int], each: int) -> Float64 | None:
    """Parse alike rows of ASCII by numpy; see `_decimals`."""
    data = np.frombuffer(text.encode(), dtype=np.uint8)
    ends = np.flatnonzero(data == _NEWLINE)
    lines = len(ends) + (data[-1:] != _NEWLINE).sum()
    if dialect.separator:
        marks = np.flatnonzero(data == ord(dialect.separator))
    else:
        is_word = data > _BLANK
        begins = is_word.copy()
        begins[1:] &= ~is_word[:-1]
        marks = np.flatnonzero(begins)
    if len(marks) != lines * each or not _are_even(marks, ends[: lines - 1], each):
        return None
    try:
        values = np.loadtxt(
            io.StringIO(text),
            comments=None,
            delimiter=dialect.separator or None,
            usecols=places,
            ndmin=2,
        )
    except ValueError:
        return None
    return values if len(values) == lines else None


def _are_even(marks: Int64, ends: Int64, each: int) -> bool:
    """Return whether as many marks stand in every line; both are offsets, ascending."""
    after = marks[each::each] if each else marks
    return bool((marks[each - 1 : -1 : each] < ends).all() and (after > ends).all())


def _picked(words: Sequence[str], layout: Layout, index: int, line: str) -> list[float]:
    """Return the wanted numbers of a row."""
    if len(line) > LONGEST_ROW:
        found = f"found a line of more than {LONGEST_ROW} characters"
        raise BrokenRowError(index, f"{found}, expected a line for each point")
    found = f"{some(len(words), 'column')} ({short(line.strip())})"
    if layout.most is not None and not layout.least <= len(words) <= layout.most:
        raise BrokenRowError(index, f"found {found}, expected the {layout.most} of the header")
    picked = []
    for name, place in layout.places.items():
        if place >= len(words):
            fault = f"found {found}, expected {name} in column {place + 1}"
            raise BrokenRowError(index, fault, name)
        word = words[place]
        try:
            value = number(word)
        except ValueError:
            value = None
        if value is None or (name == "keyframe" and not math.isfinite(value)):
            fault = f"found {short(word) or 'nothing'} as {name}, expected a number"
            with_comma = has_decimal_comma(word)
            fault += " with a decimal point" * with_comma
            raise BrokenRowError(index, fault, name, is_written_so=with_comma)
        picked.append(value)
    return picked


def _lacks_keyframes(values: Float64, names: list[str]) -> bool:
    """Return whether a number is no keyframe, in the column of that name."""
    return "keyframe" in names and not np.isfinite(values[:, names.index("keyframe")]).all()


def short(text: str) -> str:
    """Quote a text, cut to 40 characters; an empty text stays empty."""
    return repr(text if len(text) <= 40 else text[:37] + "...") if text else ""
