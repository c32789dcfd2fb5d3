"""How a text of numbers is written: its encoding, its fields, and which words are numbers.

Such texts come from viewers of point clouds, spreadsheets and many small programs, and nothing in
them says how they are to be read. What holds for all that are read here:

- **Encoding**: UTF-8; or UTF-16 or UTF-32, told by a byte order mark or by the zeros among ASCII.
- **One separator** for the whole text: semicolons, tabs, commas, bars (of a table, ``|`` also at
  both ends of a row), or any number of blanks and tabs. It is the one by which the first rows fall
  into alike many fields with three numbers or more.
  Where it is no blank, blanks belong to the field, as in ``Slot ID`` or a date with its time.
- **Quotes** protect separators, and are no part of the field.
- **Missing values** are empty fields or a word such as ``NA``. Separators at the end of a line mean
  nothing.
- **Numbers** have decimal points, ASCII digits and no separators of thousands. ``nan`` and ``inf``
  are numbers, also as C libraries of Windows write them: ``-nan(ind)``, ``1.#QNAN``, ``-1.#INF``. A
  number with a decimal comma is recognised, to be refused: it is never split.
- **Comments** begin with ``#``, and at the start of a line also with ``//`` or ``%``.
"""

from __future__ import annotations

import codecs
import csv
import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple, TextIO

from mlscli.io.files import open_input, open_text_input

BLANKS = " \t"
SEPARATORS = ",;| \t"
MARKS = "#\"'/%"
"""Characters that begin a comment or a quoted field, or may do so."""

_SAMPLE_ROWS = 50
# The byte order mark that begins a text which was appended to another.
_MARK = "\ufeff"
# Fewer numbers in a row are no point.
_LEAST_NUMBERS = 3
# Not the one in 1.#IND, not within a name, as in P#1, not the errors of a spreadsheet, and not the
# number or the colour that is a field.
_COMMENT = re.compile(
    r"(?<![A-Za-z.])#(?!N/A|VALUE!|REF!|DIV/0!|NUM!|NAME\?|(?<=[,;\t\"]#)[0-9A-Fa-f]+[\"\s]*(?:[,;\t]|$))"
)
# Digits are matched in one way alone: long rows of them that end wrong cost no square.
_NUMBER = re.compile(
    r"[+-]?(?:(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|nan|inf|infinity)", re.IGNORECASE
)
_DECIMAL_COMMA = re.compile(r"[+-]?(?:[0-9]+,[0-9]*|,[0-9]+)(?:[eE][+-]?[0-9]+)?")
_WINDOWS = re.compile(
    r"([+-]?)(?:1\.#?(?P<inf>inf)0*|1\.#(?:ind|qnan|snan)0*|nan\((?:ind|snan|[0-9a-fx]*)\)|[qs]nan)",
    re.IGNORECASE,
)
_ABSENT = frozenset(
    (
        *("", "na", "n/a", "null", "none", "<na>"),
        *("#n/a", "#value!", "#ref!", "#div/0!", "#num!", "#name?"),
    )
)
_QUOTED = re.compile(r"\"([^\"]*)\"(?=[ \t]|$)|'([^']*)'(?=[ \t]|$)|([^ \t]+)")
_ENCODINGS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)


def encoding_of(head: bytes) -> str:
    """Return the encoding of a text that begins with these bytes, as Python names it."""
    for mark, encoding in _ENCODINGS:
        if head.startswith(mark):
            return encoding
    # ASCII in two bytes each has a zero in every other one, and nowhere else.
    some = head[: len(head) // 2 * 2]
    low, high = some[::2], some[1::2]
    if len(some) >= 4 and not any(high) and all(low):
        return "utf-16-le"
    if len(some) >= 4 and not any(low) and all(high):
        return "utf-16-be"
    return "utf-8-sig"


def open_text(path: Path) -> TextIO:
    """Open a text in its encoding; what is no character of it is read as U+FFFD."""
    with open_input(path) as file:
        encoding = encoding_of(file.read(1 << 12))
    return open_text_input(path, encoding)


class Dialect(NamedTuple):
    """How the lines of one text fall into fields.

    Attributes
    ----------
    separator : str
        Between fields: a semicolon, a tab, a comma, a bar; empty for any number of blanks and tabs.
    width : int
        How many fields most of the first rows have; 0 where there is none.
    """

    separator: str
    width: int

    @classmethod
    def of(cls, lines: Iterable[str], separator: str | None = None) -> Dialect:
        """Find out how a text is written.

        Parameters
        ----------
        lines : iterable of str
            The first of it; comments, headers and blank lines among them.
        separator : str, optional
            As the text itself names it.
        """
        rows = [line for line in lines if not is_blank(line) and not is_comment(line)]
        tried = [
            _score(cls(each, 0), rows[:_SAMPLE_ROWS], preference)
            for preference, each in enumerate((";", "\t", ",", "|", ""))
            if separator is None or each == separator.strip(" ")
        ]
        _, dialect = max(tried, key=lambda scored: scored[0])
        return dialect if dialect.width > 1 else cls("", dialect.width)

    def fields(self, line: str) -> list[str]:
        """Split a line into fields, empty for missing values; a comment or blank line has none."""
        if "#" in line and (comment := _COMMENT.search(line)) and not _in_quotes(line, comment):
            line = line[: comment.start()]
        line = line.lstrip(_MARK).rstrip()
        if self.separator == "|" and line.endswith("|") and line.lstrip().startswith("|"):
            line = line.lstrip()[1:]
        line = line.rstrip(SEPARATORS)
        # A tab at the beginning may end an empty field.
        line = line.lstrip(" " if self.separator == "\t" else None)
        if not line or line.startswith(("//", "%")):
            return []
        if not self.separator:
            if '"' in line or "'" in line:
                return ["".join(parts) for parts in _QUOTED.findall(line)]
            return line.split()
        words = line.split(self.separator)
        if '"' in line:
            # What csv refuses, a field without end or an end of a line in one, holds no numbers.
            with suppress(csv.Error):
                (words,) = csv.reader([line], delimiter=self.separator, skipinitialspace=True)
        return [_bare(word) for word in words]


def is_blank(line: str) -> bool:
    """Return whether a line holds nothing but separators; a comment is not blank."""
    return not line.strip(SEPARATORS + "\r\n")


def is_comment(line: str) -> bool:
    """Return whether a line is nothing but a comment."""
    line = line.lstrip(SEPARATORS)
    return bool(_COMMENT.match(line)) or line.startswith(("//", "%"))


def is_number(word: str) -> bool:
    """Return whether a word is a number; ``nan`` and ``inf`` are, ``1_0`` is none."""
    return bool(_NUMBER.fullmatch(word) or _WINDOWS.fullmatch(word))


def has_decimal_comma(word: str) -> bool:
    """Return whether a word would be a number if its comma were a decimal point."""
    return "," in word and bool(_DECIMAL_COMMA.fullmatch(word))


def number(word: str) -> float:
    """Return the number that a word is; NaN for a missing value.

    Raises
    ------
    ValueError
        It is no number.
    """
    if _NUMBER.fullmatch(word):
        return float(word)
    if windows := _WINDOWS.fullmatch(word):
        return float(windows[1] + "inf") if windows["inf"] else math.nan
    if word.lower() in _ABSENT:
        return math.nan
    raise ValueError


def common_width(rows: Iterable[Sequence[str]]) -> int:
    """Return how many fields most rows have, the first such number; 0 where there is no row."""
    widths = Counter(map(len, rows))
    return widths.most_common(1)[0][0] if widths else 0


def _score(
    dialect: Dialect, rows: Sequence[str], preference: int
) -> tuple[tuple[int, ...], Dialect]:
    """Return how well a separator fits rows, the larger the better, and it with their width."""
    split = [words for row in rows if (words := dialect.fields(row))]
    points = [words for words in split if _numbers(words) >= _LEAST_NUMBERS]
    width = common_width(points) or common_width(split)
    alike = [words for words in points if len(words) == width]
    others = sum(len(words) - _numbers(words) for words in alike)
    # Tabs that align columns stand side by side, but not for missing values.
    aligned = dialect.separator == "\t" and any("" in words for words in points)
    rank = (
        len(alike),
        not aligned,
        0 if alike else min(width, _LEAST_NUMBERS),
        -others,
        -preference,
    )
    return rank, dialect._replace(width=width)


def _numbers(words: Sequence[str]) -> int:
    """Return how many words are numbers, with a decimal comma too, or missing beside numbers."""
    there = sum(is_number(word) or has_decimal_comma(word) for word in words)
    return there + sum(not word for word in words) if there else 0


def _in_quotes(line: str, comment: re.Match[str]) -> bool:
    return line.count('"', 0, comment.start()) % 2 == 1


def _bare(word: str) -> str:
    """Return a field without the blanks and single quotes around it."""
    word = word.strip()
    quoted = len(word) > 1 and word[0] == word[-1] and word[0] in "'\""
    return word[1:-1].strip() if quoted else word
