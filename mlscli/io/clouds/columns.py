"""Parse lines of text as columns: their names, fields and numbers."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TextIO

import numpy as np

from mlscli.errors import InputError, UsageError
from mlscli.runtime.arrays import Float64

CENTRE, ATTITUDE = ("cx", "cy", "cz"), ("qx", "qy", "qz", "qw")
COLUMNS = ("x", "y", "z", "keyframe", "t", *CENTRE, *ATTITUDE)

BLOCK_CHARACTERS = 1 << 22
"""Characters read at a time."""

_LONGEST_LINE = 1 << 16
_OTHER_NAMES = {"pos_x": "x", "pos_y": "y", "pos_z": "z", "kf": "keyframe", "kf_id": "keyframe"}
_SEPARATOR = re.compile(r"[ \t]*[,;][ \t]*|[ \t]+")
_SEPARATORS = ",; \t"
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?")
_TO_BLANK = str.maketrans(",;", "  ")
_WITHOUT_BLANKS = str.maketrans(";", ",", " \t")


def blocks(file: TextIO, path: Path) -> Iterator[tuple[int, str]]:
    """Yield whole lines a few megabytes at a time.

    Yields
    ------
    line : int
        Number of the first of them, from 1.
    text : str

    Raises
    ------
    InputError
        A line is longer than any row of numbers.
    """
    line = 1
    while text := file.read(BLOCK_CHARACTERS):
        if not text.endswith("\n"):
            text += file.readline(_LONGEST_LINE)
        if len(text) - text.rfind("\n") > _LONGEST_LINE:
            raise InputError(
                f"{path}:{line + text.count(chr(10))}: found a line of more than "
                f"{_LONGEST_LINE} characters, expected a line for each point"
            )
        yield line, text
        line += text.count("\n")


def parse_columns(columns: str) -> dict[str, int]:
    """Return the index of each column named in ``x,y,z,-,keyframe``; ``-`` skips a column.

    Raises
    ------
    UsageError
        A name is unknown or repeated, or x, y, z is missing, or part of cx, cy, cz or of qx, qy,
        qz, qw.
    """
    names = [name.strip().lower() for name in columns.split(",")]
    for name in names:
        if name != "-" and name not in COLUMNS:
            fault = f"found {name!r}"
        elif name != "-" and names.count(name) > 1:
            fault = f"{name} is named more than once"
        else:
            continue
        break
    else:
        fault = _missing(names)
    if fault:
        raise UsageError(
            f"`columns` {columns}: {fault}; the names are {', '.join(COLUMNS)}, each at most "
            "once, and - for a column to skip; x, y and z are needed"
        )
    return {name: names.index(name) for name in names if name != "-"}


def header_columns(names: Sequence[str]) -> dict[str, int] | None:
    """Return the index of each known column of a header; None where some lack or are repeated."""
    known = [_OTHER_NAMES.get(name, name) for name in names]
    if not {*ATTITUDE} <= {*known}:
        # Numbers of another kind have such names, too.
        known = ["-" if name in ATTITUDE else name for name in known]
    if _missing(known) or any(known.count(name) > 1 for name in COLUMNS):
        return None
    return {name: known.index(name) for name in known if name in COLUMNS}


def is_known(name: str) -> bool:
    """Return whether a column of a header is one that is read."""
    return _OTHER_NAMES.get(name, name) in COLUMNS


def _missing(names: Sequence[str]) -> str:
    """Return which columns are missing, as text; empty where none is."""
    needed = ["x", "y", "z"]
    for together in (CENTRE, ATTITUDE):
        needed += together if any(name in names for name in together) else ()
    absent = [name for name in needed if name not in names]
    return f"{', '.join(absent)} missing" if absent else ""


def fields(line: str) -> list[str]:
    """Split a line into fields, empty for missing values; a comment or blank line has none."""
    line = line.partition("#")[0].strip(" \t").rstrip(_SEPARATORS)
    if not line or line.startswith("//"):
        return []
    return [word.strip("\"'") for word in _SEPARATOR.split(line)]


def has_decimal_commas(line: str) -> bool:
    """Return whether a line is of numbers like 1,5 separated by semicolons, blanks or tabs."""
    words = line.partition("#")[0].strip().rstrip(";").replace(";", " ").split()
    return len(words) > 1 and all(_DECIMAL_COMMA.fullmatch(word) for word in words)


def header_names(line: str) -> list[str]:
    """Return the names in a header, commented or not, in lower case."""
    return [name.lower() for name in fields(line.strip().lstrip("#/"))]


def is_blank(line: str) -> bool:
    """Return whether a line holds nothing but separators; a comment is not blank."""
    return not line.strip(_SEPARATORS)


def is_number(word: str) -> bool:
    """Return whether Python reads a word as a number; ``nan`` and ``inf`` are numbers."""
    try:
        float(word)
    except ValueError:
        return False
    return "_" not in word


def clean(text: str) -> str:
    """Return lines of fields separated by blanks, missing values as nan, without comments.

    Blank lines are kept; lines that are only a comment are removed.
    """
    bare = text.translate(_WITHOUT_BLANKS)
    plain = not any(mark in text for mark in ("#", "//", '"', "'")) and not any(
        empty in bare for empty in (",,", ",\n", "\n,")
    )
    if plain and not bare.startswith(",") and not bare.endswith(","):
        return text.translate(_TO_BLANK)
    lines = ((line, fields(line)) for line in text.split("\n"))
    return "\n".join(
        " ".join(word or "nan" for word in words)
        for line, words in lines
        if words or is_blank(line)
    )


def numbers(cleaned: str, places: Iterable[int]) -> Float64 | None:
    """Parse columns of cleaned lines.

    Parameters
    ----------
    cleaned : str
        At least one line that is not blank.
    places : ints
        Indices of the columns to return, in this order.

    Returns
    -------
    float64 (N, columns) or None
        Each number as Python's `float` reads it; None if a line is broken.
    """
    try:
        return np.loadtxt(io.StringIO(cleaned), comments=None, usecols=tuple(places), ndmin=2)
    except ValueError:
        return None


def first_fault(text: str, layout: dict[str, int]) -> tuple[int, str]:
    """Return the index of the first broken line, and what was found and expected there.

    Parameters
    ----------
    text : str
        Lines of which one is broken.
    layout : dict of str to int
        Index of each column, by name.
    """
    for number, line in enumerate(text.split("\n")):
        words = fields(line)
        for name, place in layout.items() if words else ():
            if place >= len(words):
                count = f"{len(words)} column{'s' if len(words) > 1 else ''}"
                found = f"{count} ({short(line.strip())})"
                return number, f"found {found}, expected {name} in column {place + 1}"
            word = words[place]
            optional = name != "keyframe" and not word
            if not optional and not (is_number(word) and _may_be(float(word), name)):
                return number, f"found {short(word) or 'nothing'} as {name}, expected a number"
    return 0, "found characters among the numbers that are no digits, expected plain numbers"


def short(text: str) -> str:
    """Quote a text, cut to 40 characters; an empty text stays empty."""
    return repr(text if len(text) <= 40 else text[:37] + "...") if text else ""


def _may_be(value: float, name: str) -> bool:
    return math.isfinite(value) or name != "keyframe"
