"""Text clouds: columns of numbers, one point a line.

Columns are x y z [keyframe] by position, or as a header or `columns` names them. They are separated
by blanks, tabs, commas and semicolons, also mixed. A comma or semicolon with nothing before it
stands for a missing value; separators at the end of a line mean nothing. ``#`` begins a comment; so
does ``//`` at the start of a line. A file is cleaned into plain columns a block at a time and
parsed by numpy; only where that fails are its lines examined.

Points with the same value in the column keyframe form a keyframe, in order of first appearance.
Without that column, points with the same time form one, unless most have a time of their own.
Otherwise blank lines separate keyframes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mlscli.errors import InputError
from mlscli.io.clouds import columns as lines
from mlscli.io.clouds.pointfile import Content, PointFile
from mlscli.io.clouds.trajectory import is_trajectory
from mlscli.io.source import Cloud, rows_by_first_appearance
from mlscli.runtime.arrays import Array, Bool, Float64, Int64


class TextCloud(PointFile):
    """A text cloud, held whole.

    Parameters
    ----------
    path : Path
    columns : str, optional
        Names of the columns, see `parse_columns`; those in a header are then not read.

    Raises
    ------
    UsageError
        `columns` is wrong.
    """

    kind = "text cloud"

    def __init__(self, path: Path, columns: str | None = None) -> None:
        super().__init__(path)
        self._layout = None if columns is None else lines.parse_columns(columns)

    def _read(self) -> Content:
        """Return a cloud for each keyframe, with the time and pose in its first row."""
        table = _Parser(self.path, self._layout).parse()
        xyz = table.columns("x", "y", "z")
        stamps = table.column("t")
        keyframes = rows_by_first_appearance(table.labels)
        first = table.at(np.array([rows[0] for rows in keyframes], dtype=np.int64))
        clouds = []
        for rows, stamp, position, attitude in zip(
            keyframes,
            first.column("t").tolist(),
            first.columns(*lines.CENTRE).tolist(),
            first.columns(*lines.ATTITUDE).tolist(),
            strict=True,
        ):
            x, y, z = position
            qx, qy, qz, qw = attitude
            clouds.append(Cloud(xyz[rows], stamp, (x, y, z), attitude=(qx, qy, qz, qw)))
        return Content(clouds, table.notes, stamps=stamps)


@dataclass(frozen=True, eq=False)
class _Table:
    """A text cloud as parsed.

    Attributes
    ----------
    values : float64 (N, columns)
    names : list of str
        Of the columns.
    labels : (N,)
        The keyframe of each row.
    notes : list of str
        What the user should know about how it was read.
    """

    values: Float64
    names: list[str]
    labels: Array
    notes: list[str]

    def column(self, name: str) -> Float64:
        """Return a column, float64 (N,); NaN where the text has none of that name."""
        if name not in self.names:
            return np.full(len(self.values), math.nan)
        return self.values[:, self.names.index(name)]

    def at(self, rows: Int64) -> _Table:
        """Return some rows (M,)."""
        return replace(self, values=self.values[rows], labels=self.labels[rows])

    def columns(self, *names: str) -> Float64:
        """Return columns side by side, float64 (N, columns)."""
        return np.stack([self.column(name) for name in names], axis=1)


class _Parser:
    """Reads a text cloud once, from its first line to its last."""

    def __init__(self, path: Path, layout: dict[str, int] | None) -> None:
        self.path = path
        self.layout = layout
        self.named = layout is not None
        self.headed = False
        self.guessed = False
        self.comments: list[list[str]] = []
        self.notes: list[str] = []

    def parse(self) -> _Table:
        """Return all numbers of the file.

        Raises
        ------
        InputError
            The file holds no points, a line is broken, or it is a trajectory.
        """
        begun = False
        after_blank = True
        blocks: list[Float64] = []
        starts: list[Bool] = []
        with self.path.open(encoding="utf-8-sig", errors="replace") as file:
            for first_line, text in lines.blocks(file, self.path):
                if not begun:
                    begun, text = self._begin(text, first_line)
                cleaned = lines.clean(text)
                block_starts, after_blank = _starts(cleaned, after_blank)
                if len(block_starts):
                    blocks.append(self._numbers(cleaned, text, first_line))
                    starts.append(block_starts)
        if not blocks or self.layout is None:
            raise InputError(f"{self.path}: holds no points")
        if self.guessed:
            self.notes.append(
                f"{self.path}: the fourth column holds whole numbers and is taken as the keyframe; "
                "`columns` x,y,z says that it is not"
            )
        names = list(self.layout)
        # Blocks read before the fourth column turned out to be no keyframe still hold it.
        values = np.concatenate([block[:, : len(names)] for block in blocks])
        labels: Array = np.cumsum(np.concatenate(starts))
        if "keyframe" in names:
            labels = values[:, names.index("keyframe")]
        elif "t" in names:
            labels = self._by_time(values[:, names.index("t")], labels)
        return _Table(values, names, labels, self.notes)

    def _by_time(self, times: Float64, labels: Array) -> Array:
        """Return the times as labels; `labels` where most points have a time of their own."""
        if 2 * len(np.unique(times)) <= len(times):
            return times
        self.notes.append(
            f"{self.path}: most points have a time of their own, which tells no keyframes apart; "
            "blank lines and a column named keyframe do"
        )
        return labels

    def _begin(self, text: str, first_line: int) -> tuple[bool, str]:
        """Choose the columns by the header or the first point, if there is one.

        Returns whether there was a point, and the text with the line of the header left blank.
        """
        rows = text.split("\n")
        for number, row in enumerate(rows):
            words = lines.fields(row)
            if not words:
                self.comments.append(lines.header_names(row))
                continue
            is_header = not any(lines.is_number(word) or not word for word in words)
            if is_header and not self.headed:
                self.headed = True
                rows[number] = ""
                if not self.named:
                    self.layout = self._by_name(row)
                continue
            if lines.has_decimal_commas(row):
                raise InputError(
                    f"{self.path}:{first_line + number}: found {row.strip()[:40]!r}, with decimal "
                    "commas; expected decimal points"
                )
            if self.layout is None:
                self._refuse_trajectory(rows[number:])
                self.layout = self._by_position(len(words))
            return True, "\n".join(rows)
        return False, "\n".join(rows)

    def _refuse_trajectory(self, rows: list[str]) -> None:
        if is_trajectory(words for row in rows if (words := lines.fields(row))):
            raise InputError(
                f"{self.path}: holds no cloud but a trajectory (stamp x y z qx qy qz qw): name the "
                "cloud, and this file after `route`; `columns` x,y,z takes it for points all the "
                "same"
            )

    def _by_name(self, header: str) -> dict[str, int]:
        """Return the columns that a header names."""
        layout = lines.header_columns(lines.header_names(header))
        if layout is None:
            raise InputError(
                f"{self.path}: found {header.strip()[:60]!r} before the first point, expected "
                "numbers or a header that names x, y and z once each"
            )
        unused = [name for name in lines.header_names(header) if not lines.is_known(name)]
        if unused:
            self.notes.append(_unused(self.path, f"columns {', '.join(unused)} are"))
        return layout

    def _by_position(self, count: int) -> dict[str, int]:
        """Return the columns that a commented header names, or else x y z [keyframe]."""
        for names in reversed(self.comments):
            layout = lines.header_columns(names)
            if layout is not None and len(names) == count:
                return layout
        if count > 4:
            self.notes.append(_unused(self.path, f"{count - 3} columns after x, y, z are"))
        self.guessed = count == 4
        return {"x": 0, "y": 1, "z": 2, **({"keyframe": 3} if self.guessed else {})}

    def _numbers(self, cleaned: str, text: str, first_line: int) -> Float64:
        """Return the named columns of a block, or raise the error that names its broken line."""
        assert self.layout is not None
        block = lines.numbers(cleaned, self.layout.values())
        if self.guessed and (block is None or not _all_whole(block[:, 3])):
            self.guessed = False
            del self.layout["keyframe"]
            self.notes.append(_unused(self.path, "fourth column, not of whole numbers only, is"))
            return self._numbers(cleaned, text, first_line)
        names = list(self.layout)
        if block is None or (
            "keyframe" in names and not np.isfinite(block[:, names.index("keyframe")]).all()
        ):
            number, fault = lines.first_fault(text, self.layout)
            raise InputError(f"{self.path}:{first_line + number}: {fault}")
        return block


def _starts(cleaned: str, after_blank: bool) -> tuple[Bool, bool]:
    """Return for each point whether a blank line precedes it, and whether one ends the block."""
    rows = cleaned.removesuffix("\n").split("\n")
    filled = np.fromiter(map(bool, map(str.strip, rows)), dtype=np.bool_, count=len(rows))
    blank_before = np.concatenate([[after_blank], ~filled[:-1]])
    return blank_before[filled], not filled[-1]


def _all_whole(values: Float64) -> bool:
    return bool(np.all(np.isfinite(values) & (values == np.floor(values))))


def _unused(path: Path, what: str) -> str:
    return f"{path}: the {what} not used; `columns` says what they hold"
