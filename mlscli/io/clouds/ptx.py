"""PTX files, those of Leica Cyclone and of other scanners that stand, as clouds.

A scan begins with ten lines: the number of columns and of rows of its raster; the position of the
scanner and its three axes, three numbers each; and a matrix 4 x 4, by which a point as a row of
four, x y z 1, is multiplied to come into the frame that all scans of the file share. A line for
each point of the raster follows, column by column: ``x y z i`` or ``x y z i r g b``, in the
scanner's own frame, with 0 0 0 where nothing was hit. More scans may follow in the same way. (P.
Bourke, ptx plain text data format, 2015; manual of SpatialAnalyzer, PTX.)

The points that stand there count, not their declared number: a scan ends where the next one begins,
or with the file.

The scanner stands where the matrix takes its origin, as the position in the header may be that of
before a change of coordinates.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import numpy as np

from mlscli.errors import InputError
from mlscli.geometry.poses import turn
from mlscli.io.clouds.dialect import Dialect, is_number, number, open_text
from mlscli.io.clouds.pointfile import Content, PointFile, shortfall
from mlscli.io.clouds.rows import alike, blocks, short
from mlscli.io.source import Cloud
from mlscli.runtime.arrays import Float64
from mlscli.words import some

HEADER = (1, 1, 3, 3, 3, 3, 4, 4, 4, 4)
"""How many numbers each line of a header has."""

NOTHING_HIT = "no return"

_COUNT = re.compile(r"[0-9]{1,18}")
_LONGEST_COUNT = 30
_AT_ONCE = 100_000
_TURNED = 1e-3
"""How far a matrix may be from one that turns and moves."""


def is_ptx(head: bytes) -> bool:
    """Return whether the first bytes of a file are the header of a PTX."""
    lines = head.decode("utf-8", "replace").removeprefix("\ufeff").split("\n", len(HEADER))
    words = [line.split() for line in lines[: len(HEADER)]]
    return tuple(map(len, words)) == HEADER and _is_header(words)


def _is_header(words: list[list[str]]) -> bool:
    counts = (words[0][0], words[1][0])
    return all(map(_COUNT.fullmatch, counts)) and all(map(is_number, chain(*words[2:])))


class PtxCloud(PointFile):
    """A PTX file: each scan is a keyframe, seen from where its scanner stood."""

    kind = "PTX cloud"

    def _read(self) -> Content:
        with open_text(self.path) as file:
            scans = _Scans(self.path, blocks(file))
            clouds = list(scans.clouds())
        return Content(clouds, scans.notes, scans.losses)


class _Scans:
    """The scans of a file, in turn; complete when all have been read."""

    def __init__(self, path: Path, text: Iterator[tuple[int, str]]) -> None:
        self.notes: list[str] = []
        self.losses: list[str] = []
        self._path, self._text = path, text
        self._lines: list[str] = []
        self._ends_whole = True

    def clouds(self) -> Iterator[Cloud]:
        """Yield each scan in the frame of the file.

        Raises
        ------
        InputError
            The matrix of a scan cannot be that of a scanner.
        """
        number_of_scan = 0
        while header := self._take(len(HEADER)):
            number_of_scan += 1
            words = [line.split() for line in header]
            if tuple(map(len, words)) != HEADER or not _is_header(words):
                self.losses.append(
                    f"{self._path}: the header of scan {number_of_scan} cannot be read: found "
                    f"{short(header[0].strip())}, expected {len(HEADER)} lines; the rest is lost"
                )
                return
            yield self._scan(words, number_of_scan)

    def _scan(self, header: list[list[str]], number_of_scan: int) -> Cloud:
        declared = int(header[0][0]) * int(header[1][0])
        matrix = np.array([[number(word) for word in row] for row in header[6:]])
        if not _moves(matrix):
            raise InputError(
                f"{self._path}: found a matrix in the header of scan {number_of_scan} that does "
                "more than turn and move, expected the pose of a scanner, 0 0 0 1 down its right"
            )
        parts, came, fault = [np.empty((0, 3))], 0, ""
        while lines := self._rows(declared - came):
            points, broken = _parsed(lines)
            parts.append(points)
            came += len(lines)
            if broken and not fault:
                fault = f"the first is {short(lines[broken[0]].strip())}, expected 4 or 7 numbers"
        points = np.concatenate(parts)
        name = f"{self._path}: scan {number_of_scan}"
        if len(points) < declared:
            fault = fault or "the scan ends before them"
            self.losses.append(shortfall(self._path, len(points), declared, fault))
        elif len(points) > declared:
            self.notes.append(
                f"{name} declares {some(declared, 'point')} and holds {len(points):,}; all are read"
            )
        hit = points.any(axis=1)
        missed = len(points) - int(np.count_nonzero(hit))
        placed = turn(matrix[:3, :3].T, points) + matrix[3, :3]
        placed[~hit] = np.nan
        x, y, z = matrix[3, :3].tolist()
        unmeasured = ((NOTHING_HIT, missed),) if missed else ()
        return Cloud(placed, position=(x, y, z), unmeasured=unmeasured, is_ranged=True)

    def _rows(self, missing: int) -> list[str]:
        """Return the next lines of a scan that misses so many; none where another one begins."""
        lines = self._take(_AT_ONCE)
        begins = (
            row
            for row, line in enumerate(lines)
            if len(line) < _LONGEST_COUNT and _COUNT.fullmatch(line.strip())
        )
        stop = next(begins, len(lines))
        self._lines = lines[stop:] + self._lines
        rows = lines[:stop]
        if rows and len(rows) < missing and stop == len(lines) and not self._ends_whole:
            # Cut within its last number, a line looks whole.
            rows.pop()
        return rows

    def _take(self, count: int) -> list[str]:
        """Return the next lines that are not blank, at most so many."""
        while len(self._lines) < count:
            _, text = next(self._text, (0, ""))
            if not text:
                break
            self._ends_whole = text.endswith("\n")
            self._lines += [line for line in text.split("\n") if line.strip()]
        taken, self._lines = self._lines[:count], self._lines[count:]
        return taken


def _moves(matrix: Float64) -> bool:
    """Return whether a matrix (4, 4), for rows, only turns and moves."""
    rotation = matrix[:3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        apart = np.abs(rotation @ rotation.T - np.eye(3)).max()
    is_affine = np.array_equal(matrix[:, 3], [0, 0, 0, 1])
    return bool(np.isfinite(matrix).all() and is_affine and apart < _TURNED)


def _parsed(lines: list[str]) -> tuple[Float64, list[int]]:
    """Return the points of lines, and the indices of lines that are none."""
    width = len(lines[0].split()) if lines else 0
    if width in (4, 7):
        values = alike("\n".join(lines), Dialect("", width), range(width))
        if values is not None and len(values) == len(lines):
            return values[:, :3].copy(), []
    points, broken = [], list[int]()
    for row, line in enumerate(lines):
        words = line.split()
        if len(words) in (4, 7) and all(map(is_number, words)):
            points.append([number(word) for word in words[:3]])
        else:
            broken.append(row)
    return np.array(points).reshape(-1, 3), broken
