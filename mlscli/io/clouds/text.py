"""Text clouds: columns of numbers, one point a line.

Columns are x y z [keyframe] by position, or as a header or `columns` names them. How they are
separated, and what else may stand in such a text, says `dialect.py`; what may stand before the
first row, `opening.py`; and what speaks against columns by position, `layouts.py`.

Points with the same value in the column keyframe form a keyframe, in order of first appearance.
Without that column, points with the same time form one, unless most have a time of their own.
Otherwise blank lines separate keyframes.

A line that holds no point is a loss, unless it is the first one, half of all lines are so, or it
has decimal commas. A broken last line without a newline shows that the text was cut.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mlscli.errors import InputError
from mlscli.io.clouds.columns import ATTITUDE, CENTRE, Layout, parse_columns
from mlscli.io.clouds.dialect import open_text
from mlscli.io.clouds.layouts import layout_of, unused_note
from mlscli.io.clouds.opening import read_opening
from mlscli.io.clouds.pointfile import Content, PointFile, shortfall
from mlscli.io.clouds.posecolumns import (
    are_places_of_images,
    are_poses_of_a_craft,
    columns_of_positions,
)
from mlscli.io.clouds.rows import LONGEST_ROW, BrokenRowError, Rows, blocks, parse, short
from mlscli.io.plausibility.clocks import in_seconds
from mlscli.io.plausibility.counts import more_than
from mlscli.io.source import Cloud, rows_by_first_appearance
from mlscli.runtime.arrays import Array, Bool, Float64, Int64
from mlscli.words import some, verb

_COUNT = re.compile(r"[0-9]{1,18}")


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
        self._columns = None if columns is None else parse_columns(columns)

    def _read(self) -> Content:
        """Return a cloud for each keyframe, with the time and pose in its first row."""
        table = _Parser(self.path, self._columns).parse()
        xyz = table.columns("x", "y", "z")
        found = in_seconds(table.column("t") if "t" in table.names else np.empty(0))
        stamps = found.accepted(InputError)
        notes = [*table.notes, *([f"{self.path}: {found.note}"] if found.note else [])]
        keyframes = rows_by_first_appearance(table.labels)
        each = np.array([rows[0] for rows in keyframes], dtype=np.int64)
        first = table.at(each)
        times = stamps[each] if len(stamps) else np.full(len(each), math.nan)
        clouds = []
        for rows, stamp, position, attitude in zip(
            keyframes,
            times.tolist(),
            first.columns(*CENTRE).tolist(),
            first.columns(*ATTITUDE).tolist(),
            strict=True,
        ):
            x, y, z = position
            qx, qy, qz, qw = attitude
            # All rows are in order.
            points = xyz if len(keyframes) == 1 else xyz[rows]
            clouds.append(Cloud(points, stamp, (x, y, z), attitude=(qx, qy, qz, qw)))
        return Content(clouds, notes, table.losses, stamps[np.isfinite(stamps)])


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
    losses : list of str
        What could not be read.
    """

    values: Float64
    names: list[str]
    labels: Array
    notes: list[str]
    losses: list[str]

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
        if list(names) == self.names:
            return self.values
        return np.stack([self.column(name) for name in names], axis=1)


class _Parser:
    """Reads a text cloud once, from its first line to its last."""

    def __init__(self, path: Path, columns: dict[str, int] | None) -> None:
        self.path = path
        self.opening = read_opening(path)
        self.notes: list[str] = []
        self.losses: list[str] = []
        self._broken, self._first_fault = 0, ""
        if not self.opening.rows:
            if self.opening.headers:
                layout_of(path, self.opening)
            others = self.opening.headers[1:2]
            found = f"; found {others[0][:60]!r}, expected numbers" if others else ""
            raise InputError(f"{path}: holds no points{found}")
        if columns is None:
            self._refuse_trajectory()
            self.layout = layout_of(path, self.opening)
        else:
            self.layout = Layout(dict(columns))

    def parse(self) -> _Table:
        """Return all numbers of the file.

        Raises
        ------
        InputError
            No more than half of the lines can be read, or not the first one.
        """
        values, starts, odd = np.empty((0, len(self.layout.places))), list[Bool](), 0
        for part in self._parts():
            if values.shape[1] > len(self.layout.places):
                # The fourth column turned out to be no keyframe.
                values = values[:, : len(self.layout.places)].copy()
            rows = len(values)
            # Where it lies, if it can: two copies of all numbers are more than they need.
            values.resize((rows + len(part.values), values.shape[1]), refcheck=False)
            values[rows:] = part.values
            starts.append(part.after_blank)
            odd += part.odd
        rows = len(values)
        if (odd or self._broken) and self._is_mesh(rows + self._broken):
            vertices, faces, _ = self.opening.rows[0]
            raise InputError(
                f"{self.path}: is a mesh, an OFF without its first line: {vertices} vertices and "
                f"{faces} faces; expected a cloud, such as a PLY of its vertices"
            )
        if self._broken and self._broken >= rows:
            raise InputError(self._first_fault)
        if not starts:
            raise InputError(f"{self.path}: holds no points; {self.losses[0]}")
        if self._broken:
            self.losses.append(
                f"{self._first_fault}; {self._broken:,} of {some(rows + self._broken, 'row')} "
                "cannot be read"
            )
        names = list(self.layout.places)
        notes = [*self.layout.notes, *self.notes]
        if odd and self.layout.most is None:
            notes.append(
                f"{self.path}: {odd:,} of {some(rows, 'row')} {verb(odd, 'has', 'have')} more or "
                f"fewer columns than most, which have {self.opening.width}; of all the same "
                "columns are taken"
            )
        if self.layout.guessed:
            notes.append(
                f"{self.path}: the fourth column holds whole numbers and is taken as the keyframe; "
                "`columns` x,y,z says that it is not"
            )
        declared = self.opening.declared
        if declared is not None and rows > declared:
            notes.append(f"{self.path}: {more_than(declared, rows)}")
        elif declared is not None and rows + self._broken < declared:
            self.losses.append(shortfall(self.path, rows + self._broken, declared))
        labels: Array = np.cumsum(np.concatenate(starts))
        if "keyframe" in names:
            labels = values[:, names.index("keyframe")]
        elif "t" in names:
            labels = self._by_time(values[:, names.index("t")], labels, notes)
        return _Table(values, names, labels, notes, self.losses)

    def _is_mesh(self, rows: int) -> bool:
        """Return whether the first of so many rows counts vertices, faces and edges, as in OFF."""
        words = self.opening.rows[0]
        if len(words) != 3 or not all(_COUNT.fullmatch(word) for word in words):
            return False
        vertices, faces, _ = map(int, words)
        return min(vertices, faces) > 0 and rows == 1 + vertices + faces

    def _parts(self) -> Iterator[Rows]:
        """Yield the rows of each block."""
        after_blank, came, odd, last, line = True, 0, 0, "", 1
        with open_text(self.path) as file:
            for _ in range(self.opening.first_line):
                file.readline()
            for line, text in blocks(
                file, self.opening.first_line + 1, self.opening.dialect.separator
            ):
                if last:
                    raise InputError(f"{self.path}:{line}: found a line without an end")
                ended, newline, last = text.rpartition("\n")
                if newline:
                    part = self._rows(ended + newline, line, after_blank)
                    after_blank, came = part.ends_blank, came + len(part.values)
                    odd += part.odd
                    yield part
                line += text.count("\n") if last else 0
        if fault := self._cut(last, came, odd):
            self.losses.append(
                f"{self.path}:{line}: {fault}; the text seems to be cut there, and 1 row is "
                "left out"
            )
        elif last:
            yield self._rows(last, line, after_blank)

    def _rows(self, text: str, line: int, after_blank: bool) -> Rows:
        """Return the rows of a block; count broken ones, or raise the error on one."""
        broken: list[BrokenRowError] = []
        try:
            rows = parse(text, self.opening.dialect, self.layout, after_blank, broken)
        except BrokenRowError as fault:
            if self.layout.guessed and fault.name == "keyframe":
                return self._without_keyframe(text, line, after_blank)
            raise InputError(self._at(line, fault)) from None
        if self.layout.guessed and not _all_whole(rows.values[:, 3]):
            return self._without_keyframe(text, line, after_blank)
        if broken and line + broken[0].line == self.opening.first_line + 1:
            # No point came before: it may be a header, of another format.
            raise InputError(self._at(line, broken[0]))
        if broken:
            self._first_fault = self._first_fault or self._at(line, broken[0])
            self._broken += len(broken)
        return rows

    def _at(self, line: int, broken: BrokenRowError) -> str:
        return f"{self.path}:{line + broken.line}: {broken.fault}"

    def _without_keyframe(self, text: str, line: int, after_blank: bool) -> Rows:
        """Return the rows of a block whose fourth column shows that it is no keyframe."""
        self.layout.guessed = False
        del self.layout.places["keyframe"]
        self.notes.append(unused_note(self.path, "fourth column, not of whole numbers only, is"))
        return self._rows(text, line, after_blank)

    def _cut(self, last: str, came: int, odd: int) -> str:
        """Return what shows that the last line, without a newline, was cut; empty: nothing.

        So many rows came before it, of which so many are odd.
        """
        declared = self.opening.declared
        words = self.opening.dialect.fields(last) if len(last) <= LONGEST_ROW else []
        if words and declared is not None and came + 1 < declared:
            missing = some(declared - came - 1, "line")
            return f"found {short(last.strip())} and {missing} missing after it"
        if not words or not came:
            return ""
        if "\0" in last:
            return "found zero bytes"
        if len(words) < self.opening.width and not odd:
            columns = f"{some(len(words), 'column')} ({short(last.strip())})"
            return f"found {columns}, expected {self.opening.width}"
        try:
            parse(last, self.opening.dialect, self.layout, after_blank=False)
        except BrokenRowError as broken:
            return "" if broken.name == "keyframe" and self.layout.guessed else broken.fault
        return ""

    def _by_time(self, times: Float64, labels: Array, notes: list[str]) -> Array:
        """Return the times as labels; `labels` where most points have a time of their own."""
        if 2 * len(np.unique(times)) <= len(times):
            return times
        notes.append(
            f"{self.path}: most points have a time of their own, which tells no keyframes apart; "
            "blank lines and a column named keyframe do"
        )
        return labels

    def _refuse_trajectory(self) -> None:
        if are_poses_of_a_craft(self.opening):
            columns = columns_of_positions(self.opening)
            other = f", or `columns` {columns} to take it for points all the same"
            if columns and are_places_of_images(self.opening):
                raise InputError(
                    f"{self.path}: holds no cloud but where images were taken; name the cloud"
                    f"{other}"
                )
            raise InputError(
                f"{self.path}: holds no cloud but a trajectory; name the cloud, and this file "
                f"after `route`{other if columns else ''}"
            )


def _all_whole(values: Float64) -> bool:
    return bool(np.all(np.isfinite(values) & (values == np.floor(values))))
