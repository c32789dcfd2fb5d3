"""Trajectories: the poses of a craft, in the formats that `posecolumns.py` lists, or as a PCD.

Separators and comments are as in a text cloud. Time stamps are in seconds, or in any unit that
`mlscli.io.plausibility.clocks` tells from them, as the nanoseconds of ORB-SLAM3's files.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from mlscli.errors import InputError
from mlscli.geometry.poses import PoseTrack, are_poses, identity, in_order, unit
from mlscli.io.clouds.dialect import Dialect, open_text
from mlscli.io.clouds.opening import Opening, read_opening
from mlscli.io.clouds.posecolumns import (
    GRAPH,
    MATRIX,
    POSITION,
    QUATERNION,
    TUM,
    W_FIRST,
    PoseColumns,
    by_names,
    by_numbers,
    by_position,
    ordered,
)
from mlscli.io.clouds.rows import BrokenRowError, blocks, parse, short
from mlscli.io.files import open_input
from mlscli.io.plausibility.clocks import in_seconds
from mlscli.runtime.arrays import Float64
from mlscli.words import are, some, verb

_LARGEST_FILE = 1 << 30


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The poses of a craft, in the order of time.

    Attributes
    ----------
    path : Path
    stamps : float64 (K,)
        Seconds, ascending.
    positions : float64 (K, 3)
        x, y, z, in the unit of the recording.
    attitudes : float64 (K, 4) or None
        Unit quaternions x y z w, from the axes of the craft or its camera to those of the world;
        None where not known.
    notes, losses : tuple of str
        What the user should know about how it was read, and what could not be read.
    is_timed : bool
        Whether the stamps are times; otherwise they only count the poses.
    order : str
        The order in which the numbers of quaternions are taken to stand, ``x y z w`` or
        ``w x y z``, where nothing says so; empty where it is known.
    """

    path: Path
    stamps: Float64
    positions: Float64
    attitudes: Float64 | None
    notes: tuple[str, ...] = ()
    losses: tuple[str, ...] = ()
    is_timed: bool = True
    order: str = ""

    @property
    def route(self) -> Float64:
        """Stamp, x, y, z, float64 (K, 4): rows as a map stores them."""
        return np.column_stack((self.stamps, self.positions))

    @cached_property
    def track(self) -> PoseTrack:
        """The poses, to be interpolated; with identity rotations where attitudes are not known."""
        attitudes = self.attitudes
        if attitudes is None:
            attitudes = identity(len(self.stamps)).rotation
        return PoseTrack(self.stamps, self.positions, attitudes)

    def at(self, stamps: Float64) -> Float64:
        """Return the positions, float64 (M, 3), at these stamps (M,), as `PoseTrack` finds them.

        They are NaN where not known, as at a stamp of NaN, or if the trajectory has no times.
        """
        if not self.is_timed:
            return np.full((len(stamps), 3), np.nan)
        return self.track.at(stamps).translation


def read_trajectory(path: Path) -> Trajectory:
    """Read a trajectory.

    Lines in which a number is NaN or infinite, or the quaternion has length 0, hold no pose and
    are left out with a note. Of several lines with the same time stamp the last counts.

    Raises
    ------
    InputError
        The file cannot be read, a line is broken, or there is no pose.
    """
    try:
        size = path.stat().st_size
        if size > _LARGEST_FILE:
            raise InputError(f"{path}: found {size:,} bytes, expected a trajectory of at most 1 GB")
        with open_input(path) as file:
            if is_pose_graph(file.read(1 << 12)):
                return _of_graph(path)
        opening = read_opening(path)
        if not opening.rows:
            raise InputError(f"{path}: holds no poses, expected lines of {' '.join(TUM)}")
        columns = _columns(opening)
        if columns is None:
            raise InputError(
                f"{path}: found {opening.width} columns, expected {' '.join(TUM)}, or the first "
                "four, or a header that names them"
            )
        rows, losses = _rows(path, opening, columns)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    notes = []
    if columns.order == W_FIRST:
        notes.append(f"{path}: the quaternions are taken as w x y z, as VINS and EuRoC write them")
    if columns.is_turned:
        notes.append(f"{path}: the quaternions, which have length 1, stand before the positions")
    return replace(_trajectory(path, rows, columns, notes), losses=tuple(losses))


def is_pose_graph(head: bytes) -> bool:
    """Return whether a text that begins with these bytes is a g2o file with poses."""
    return any(line.startswith(GRAPH) for line in head.decode("utf-8", "replace").split("\n"))


def _columns(opening: Opening) -> PoseColumns | None:
    """Return which columns hold poses; None where that is not known."""
    named = by_names(opening)
    if named is not None:
        return named
    separator = opening.dialect.separator
    return by_numbers(opening.rows, opening.width, separator) or by_position(opening.width)


def _rows(path: Path, opening: Opening, columns: PoseColumns) -> tuple[Float64, list[str]]:
    """Return the columns of all rows, float64 (N, columns), and losses."""
    found, losses, line = [], list[str](), 1
    with open_text(path) as file:
        for _ in range(opening.first_line):
            file.readline()
        for line, text in blocks(file, opening.first_line + 1):
            ended, newline, last = text.rpartition("\n")
            for part, first in ((ended + newline, line), (last, line + text.count("\n"))):
                try:
                    if part:
                        found.append(parse(part, opening.dialect, columns.layout, False).values)
                except BrokenRowError as broken:
                    where = f"{path}:{first + broken.line}: {broken.fault}"
                    if part is ended + newline or not found:
                        raise InputError(where) from None
                    losses.append(f"{where}; the text seems to be cut there, and 1 row is left out")
    return np.concatenate(found), losses


def _of_graph(path: Path) -> Trajectory:
    """Read the poses of a g2o file, in the order of their numbers."""
    flat, poses = Dialect("", 0), list[tuple[float, ...]]()
    with open_text(path) as file:
        for line_number, line in enumerate(file, start=1):
            words = flat.fields(line)
            if not words or words[0] not in GRAPH:
                continue
            try:
                name, *numbers = map(float, words[1:])
                if words[0] == "VERTEX_SE2":
                    x, y, turn = numbers
                    pose = (x, y, 0.0, 0.0, 0.0, np.sin(turn / 2), np.cos(turn / 2))
                else:
                    x, y, z, qx, qy, qz, qw = numbers
                    pose = (x, y, z, qx, qy, qz, qw)
            except ValueError:
                found = short(line.strip())
                raise InputError(
                    f"{path}:{line_number}: found {found}, expected {words[0]} with a number and "
                    "a pose"
                ) from None
            poses.append((name, *pose))
    return _trajectory(path, np.array(poses), PoseColumns(ordered(TUM)), [], is_timed=False)


def _trajectory(
    path: Path, rows: Float64, columns: PoseColumns, notes: list[str], *, is_timed: bool = True
) -> Trajectory:
    """Return the trajectory of rows, float64 (N, columns)."""
    names = list(columns.layout.places)

    def column(wanted: Sequence[str]) -> Float64:
        return rows[:, [names.index(name) for name in wanted]]

    attitudes = None
    if "m00" in names:
        from scipy.spatial.transform import Rotation

        matrices = column(MATRIX).reshape(-1, 3, 4)
        positions = matrices[:, :, 3]
        attitudes = Rotation.from_matrix(matrices[:, :, :3]).as_quat()
    else:
        positions = column(POSITION)
        attitudes = column(QUATERNION) if "qw" in names else None
    is_timed = is_timed and "stamp" in names
    stamps = column(["stamp"])[:, 0] if "stamp" in names else np.arange(float(len(rows)))
    quaternions = np.ones((len(rows), 4)) if attitudes is None else attitudes
    known = np.flatnonzero(are_poses(stamps, positions, quaternions))
    if not len(known):
        raise InputError(f"{path}: holds no poses, each of its {len(rows)} lines has a fault")
    lost = len(rows) - len(known)
    if lost:
        notes.append(
            f"{path}: {lost:,} of {some(len(rows), 'line')} {verb(lost, 'tells', 'tell')} no pose "
            f"and {are(lost)} left out"
        )
    if not is_timed:
        notes.append(f"{path}: its poses have no times; it is the route, but places no cloud")
    else:
        found = in_seconds(stamps[known])
        stamps[known] = found.accepted(InputError)
        notes += [f"{path}: {found.note}"] if found.note else []
    order = in_order(stamps, known)
    return Trajectory(
        path,
        stamps[order],
        positions[order] + 0.0,
        None if attitudes is None else unit(attitudes[order]),
        tuple(notes),
        is_timed=is_timed,
        order=columns.order if attitudes is not None else "",
    )
