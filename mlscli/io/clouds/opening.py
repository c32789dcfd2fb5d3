"""The beginning of a text: what stands before its first row, and how its rows are written.

Before the rows there may stand, in any order: comments; ``sep=;``, by which spreadsheets name the
separator; lines of names, of which a header is one; and the number of rows, alone on a line.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple, TextIO

from mlscli.io.clouds.columns import bare_name, without_units
from mlscli.io.clouds.dialect import (
    Dialect,
    has_decimal_comma,
    is_blank,
    is_comment,
    is_number,
    open_text,
)
from mlscli.io.clouds.rows import LONGEST_LINE

_SEPARATOR = re.compile(r"\"?sep=(.)\"?\s*", re.IGNORECASE)
_COUNT = re.compile(r"\s*([0-9]{1,18})[\s,;]*")
# Rows by which the rest is judged, and the most characters that are looked through for them.
_FIRST_ROWS = 50
_MOST_CHARACTERS = 1 << 24


class Opening(NamedTuple):
    """The beginning of a text.

    Attributes
    ----------
    dialect : Dialect
    headers : list of str
        The lines before the first row that are neither comments nor rows.
    comments : list of str
        The comments before it.
    declared : int or None
        The number of rows that a line of its own states; None: none does.
    first_line : int
        The number of lines before the first row.
    rows : list of list of str
        The fields of the first rows; none where there is no row.
    lines : list of str
        The lines of these rows.
    """

    dialect: Dialect
    headers: list[str]
    comments: list[str]
    declared: int | None
    first_line: int
    rows: list[list[str]]
    lines: list[str]

    @property
    def width(self) -> int:
        """How many fields most of the first rows have."""
        return self.dialect.width

    def names(self, header: str) -> Iterator[list[str]]:
        """Yield the names in a header as each separator parts them, that of the rows first."""
        bare = without_units(header.rstrip())
        if bare.lstrip().startswith(("#", "/", "%")):
            bare = bare.lstrip("#/% \t")
        for separator in dict.fromkeys((self.dialect.separator, ",", ";", "\t", "|", "")):
            words = self.dialect._replace(separator=separator).fields(bare)
            if words:
                yield [bare_name(word) for word in words]


def read_opening(path: Path) -> Opening:
    """Read the beginning of a text.

    Raises
    ------
    OSError
        The file cannot be read.
    """
    with open_text(path) as file:
        lines = list(_sample(file))
    separator = None
    for number, line in enumerate(lines):
        if named := _SEPARATOR.fullmatch(line):
            separator, lines[number] = named[1], "\n"
            break
        if not is_blank(line):
            break
    dialect = Dialect.of(lines, separator)
    headers, comments, declared = list[str](), list[str](), None
    for number, line in enumerate(lines):
        words = dialect.fields(line)
        if not words:
            comments += [line.strip()] if is_comment(line) else []
        elif declared is None and _is_count(line, lines[number + 1 :], dialect):
            declared = int(words[0])
        elif any(words) and not any(is_number(word) or has_decimal_comma(word) for word in words):
            headers.append(line.rstrip())
        else:
            rows = [row for row in lines[number:] if dialect.fields(row)]
            split = [dialect.fields(row) for row in rows]
            return Opening(dialect, headers, comments, declared, number, split, rows)
    return Opening(dialect, headers, comments, declared, len(lines), [], [])


def _sample(file: TextIO) -> Iterator[str]:
    """Yield lines up to enough of them that may be rows."""
    rows = characters = 0
    while rows <= _FIRST_ROWS and characters < _MOST_CHARACTERS:
        line = file.readline(LONGEST_LINE)
        if not line:
            return
        yield line
        characters += len(line)
        rows += any(map(str.isdigit, line)) and not is_comment(line)


def _is_count(line: str, following: Sequence[str], dialect: Dialect) -> bool:
    """Return whether a line is the number of rows: alone, and before a row of several fields."""
    if not _COUNT.fullmatch(line):
        return False
    next_ = next((words for each in following if (words := dialect.fields(each))), [])
    return len(next_) > 2
