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
from mlscli.io.clouds.columns import name_others
from mlscli.io.clouds.dialect import Dialect, number, open_text
from mlscli.io.clouds.opening import Opening, read_opening
from mlscli.io.clouds.posecolumns import (
    GRAPH,
    MATRIX,
    POSITION,
    QUATERNION,
    TUM,
    W_FIRST,
    PoseColumns,
    are_blocks_of_matrices,
    by_names,
    by_numbers,
    by_position,
    ordered,
    stamps_of,
)
from mlscli.io.clouds.rows import BrokenRowError, blocks, parse, short
from mlscli.io.files import open_input
from mlscli.io.plausibility.clocks import in_seconds
from mlscli.runtime.arrays import Float64
from mlscli.words import are, some, verb

_LARGEST_FILE = 1 << 30
_FAR_FROM_1 = 0.1
"""Rounded quaternions are nearer to length 1."""


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
        if are_blocks_of_matrices(opening):
            return _of_matrices(path)
        columns = _columns(opening)
        others = _other_names(opening)
        if others and (columns is None or not by_names(opening)):
            raise InputError(
                f"{path}: found {short(others)}, which names no x, y and z; expected names such as "
                f"{' '.join(TUM)}"
            )
        if columns is None:
            raise InputError(
                f"{path}: found {opening.width} columns, expected {' '.join(TUM)}, or the first "
                "four, or a header that names them"
            )
        rows, losses = _rows(path, opening, columns)
        _refuse_other_numbers(path, rows, columns)
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


def _other_names(opening: Opening) -> str:
    """Return a header or comment that names the columns, but no positions; empty: none does."""
    for header in (*opening.headers, *reversed(opening.comments)):
        for names in opening.names(header):
            if len(names) == opening.width and name_others(names):
                return header
    return ""


def _refuse_other_numbers(path: Path, rows: Float64, columns: PoseColumns) -> None:
    """Refuse rows (N, columns) in which what should be quaternions by its place is something else.

    Rounded ones are some per cent off length 1. Those that are told by their length have it.
    """
    if not columns.order:
        return
    places = [columns.layout.places[name] for name in QUATERNION]
    lengths = _lengths(rows[:, [[*columns.layout.places.values()].index(at) for at in places]])
    off = np.abs(lengths - 1) > _FAR_FROM_1
    if 2 * off.sum() > len(lengths) > 0:
        raise InputError(
            f"{path}: found lengths from {lengths.min():.4g} to {lengths.max():.4g} in columns "
            f"{min(places) + 1} to {max(places) + 1}, expected quaternions, of length 1; a first "
            f"line of names, as {' '.join(TUM)}, says what columns hold"
        )


def _lengths(quaternions: Float64) -> Float64:
    """Return the lengths of quaternions (N, 4), without those that are 0 or no numbers."""
    with np.errstate(over="ignore", invalid="ignore"):
        lengths = np.sqrt(np.square(quaternions).sum(axis=1))
    return np.asarray(lengths[np.isfinite(lengths) & (lengths > 0)])


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


def _of_matrices(path: Path) -> Trajectory:
    """Read matrices 4 x 4, a row on a line; lines of another length, as of numbers, part them."""
    flat, rows = Dialect("", 0), list[list[float]]()
    with open_text(path) as file:
        for line_number, line in enumerate(file, start=1):
            words = flat.fields(line)
            try:
                rows += [[*map(number, words)]] if len(words) == 4 else []
            except ValueError:
                raise InputError(
                    f"{path}:{line_number}: found {short(line.strip())}, expected a row of a matrix"
                ) from None
    whole = np.array(rows[: len(rows) // 4 * 4]).reshape(-1, 16)
    found = _trajectory(path, whole[:, :12], PoseColumns(ordered(MATRIX)), [], is_timed=False)
    cut = len(rows) % 4
    loss = f"{path}: the last matrix has {cut} of 4 rows, and is left out"
    return replace(found, losses=(loss,)) if cut else found


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
                if words[0] in ("VERTEX_SE2", "VERTEX2"):
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
        lengths = np.empty(0) if attitudes is None else _lengths(attitudes)
        if 2 * (np.abs(lengths - 1) > _FAR_FROM_1).sum() > len(lengths):
            attitudes = None
            notes.append(
                f"{path}: its quaternions have lengths from {lengths.min():.4g} to "
                f"{lengths.max():.4g} and not 1; attitudes are not used"
            )
    is_timed = is_timed and "stamp" in names
    places = {name: place for place, name in enumerate(names)}
    stamps = stamps_of(rows, places) + 0 if "stamp" in names else np.arange(float(len(rows)))
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
