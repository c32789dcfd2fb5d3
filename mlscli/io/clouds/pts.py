"""PTS files, those of Leica Cyclone and many scanners, as clouds.

A scan is the number of its points, alone on a line, and then a line for each point: ``x y z``,
followed in most files by an intensity ``i``, a colour ``r g b``, or both. Numbers are separated by
blanks, and all points of a file have as many. More scans may follow in the same way. (P. Bourke,
pts - Laser scan plain data format, 2014.)

The points that stand there count, not their declared number: a scan ends where the next one begins,
or with the file. A file is taken apart a block at a time, and its points are parsed by numpy; only
where that fails are its lines examined.
"""

from __future__ import annotations

import io
import re
from itertools import compress, islice
from pathlib import Path

import numpy as np

from mlscli.io.clouds import dialect
from mlscli.io.clouds import rows as lines
from mlscli.io.clouds.dialect import Dialect, is_number, open_text
from mlscli.io.clouds.pointfile import Content, PointFile, by_keyframe, shortfall
from mlscli.io.plausibility.counts import more_than
from mlscli.runtime.arrays import Array, Bool, Float64, Int64

_COUNT = re.compile(r"\s*[0-9]{1,40}\s*")
# How many numbers a point may have: x y z i r g b, x y z r g b, x y z i, x y z.
_WIDTHS = (7, 6, 4, 3)


def is_pts(head: bytes) -> bool:
    """Return whether the first bytes of a file are those of a PTS: a count, and then a point."""
    text = io.TextIOWrapper(io.BytesIO(head), "utf-8-sig", "replace")
    match list(islice(filter(None, map(str.split, text)), 2)):
        case [[count], point] if _COUNT.fullmatch(count):
            return len(point) in _WIDTHS and all(map(is_number, point))
    return False


class PtsCloud(PointFile):
    """A PTS file: each scan is a keyframe, unless none of its points is there."""

    kind = "PTS cloud"

    def _read(self) -> Content:
        scans = _Scans()
        last, last_line = "", 1
        with open_text(self.path) as file:
            for line, text in lines.blocks(file):
                ended, _, last = text.rpartition("\n")
                scans.add(ended, line)
                last_line = line + text.count("\n")
        # Cut within its last number, a line looks whole. If the last one lacks its newline, it is
        # taken only where no point is missing but this one.
        if scans.lacking <= 1:
            scans.add(last, last_line)
        return scans.content(self.path)


class _Scans:
    """The scans of a file, from its first line to the last that was added."""

    def __init__(self) -> None:
        # What stands before the first count, if anything, is a scan that declares nothing.
        self._declared = [0]
        self._width = 0
        self._points: list[Float64] = []
        # For each line of a point, broken or not: the scan, and whether it is whole.
        self._scan: list[Int64] = []
        self._is_whole: list[Bool] = []
        self._fault = ""

    @property
    def lacking(self) -> int:
        """How many points the last scan declares and has no line for; below 0 if it has more."""
        last = len(self._declared) - 1
        there = sum(int(np.count_nonzero(scan == last)) for scan in self._scan)
        return self._declared[last] - there

    def add(self, text: str, first_line: int) -> None:
        """Add lines, the first of which has this number in the file."""
        rows: Array = np.array(text.split("\n"), dtype=object)
        words = np.fromiter(map(len, map(str.split, rows)), dtype=np.int64, count=len(rows))
        is_count = words == 1
        is_count[is_count] = [bool(_COUNT.fullmatch(row)) for row in rows[is_count]]
        is_point = (words > 0) & ~is_count
        if not self._width and is_point.any():
            # What most have, as the first may be broken; as many: what the first has.
            common, first = words.tolist(), words[is_point][0]
            self._width = max(_WIDTHS, key=lambda width: (common.count(width), width == first))
        is_whole = is_point & (words == self._width)
        points, is_whole[is_whole] = _parsed(rows[is_whole], self._width)
        broken = np.flatnonzero(is_point & ~is_whole)
        if len(broken) and not self._fault:
            self._fault = (
                f"the first is line {first_line + broken[0]:,}, found "
                f"{lines.short(rows[broken[0]].strip())}, expected {self._width} numbers"
            )
        scan = len(self._declared) - 1 + np.cumsum(is_count)
        self._declared += map(int, rows[is_count])
        self._points.append(points)
        self._scan.append(scan[is_point])
        self._is_whole.append(is_whole[is_point])

    def content(self, path: Path) -> Content:
        """Return the keyframes, and by how many points they differ from what is declared."""
        points, is_whole = np.concatenate(self._points), np.concatenate(self._is_whole)
        scan = np.concatenate(self._scan)
        scans = len(self._declared)
        there = np.bincount(scan, minlength=scans).tolist()
        came = np.bincount(scan[is_whole], minlength=scans).tolist()
        declared_less, there_more, expected, fault = 0, 0, 0, self._fault
        for number, declared in enumerate(self._declared):
            if came[number] > declared:
                declared_less += declared
                there_more += came[number]
            expected += max(there[number], declared)
            if there[number] < declared and number + 1 < scans:
                fault = fault or f"scan {number} ends before them"
        note = f"{path}: {more_than(declared_less, there_more)}"
        lost = len(points) < expected
        return Content(
            by_keyframe(points, scan[is_whole]),
            [note] if there_more else [],
            [shortfall(path, len(points), expected, fault)] if lost else [],
        )


def _parsed(rows: Array, width: int) -> tuple[Float64, Bool]:
    """Return the points of rows of `width` words, and which rows hold numbers only."""
    if not len(rows):
        return np.empty((0, 3)), np.empty(0, dtype=np.bool_)
    values = lines.alike("\n".join(rows), Dialect("", width), range(width))
    if values is not None:
        return values[:, :3].copy(), np.ones(len(rows), dtype=np.bool_)
    are_numbers = [all(map(is_number, row.split())) for row in rows]
    points = [
        [dialect.number(word) for word in row.split()[:3]] for row in compress(rows, are_numbers)
    ]
    return np.array(points).reshape(-1, 3), np.array(are_numbers)
