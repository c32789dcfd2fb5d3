"""Trajectories in the format of the TUM RGB-D benchmark: a pose of a craft on each line.

A line is ``stamp x y z qx qy qz qw``, or ``stamp x y z`` where the attitude is not known, with the
separators and comments of a text cloud. Time stamps are seconds; where they reach 1e11 (3,000
years, or 100 seconds in nanoseconds) they are nanoseconds, as in the files of ORB-SLAM3.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path

import numpy as np

from mlscli.errors import InputError
from mlscli.geometry.poses import PoseTrack, are_poses, identity, in_order, unit
from mlscli.io.clouds import columns as lines
from mlscli.runtime.arrays import Float64

_COLUMNS = ("stamp", "x", "y", "z", "qx", "qy", "qz", "qw")
SECONDS_BELOW = 1e11
_LARGEST_FILE = 1 << 30
# Lines that show whether a text is a trajectory, and how far quaternions may be from length 1.
_FIRST_ROWS = 20
_ROUNDED = 1e-3


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
    notes : tuple of str
        What the user should know about how it was read.
    """

    path: Path
    stamps: Float64
    positions: Float64
    attitudes: Float64 | None
    notes: tuple[str, ...] = ()

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

        They are NaN where not known, as at a stamp of NaN.
        """
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
    text = _without_header(_text(path))
    first = next((words for line in text.split("\n") if (words := lines.fields(line))), None)
    if first is None:
        raise InputError(f"{path}: holds no poses, expected lines of {' '.join(_COLUMNS)}")
    if len(first) not in (4, 8):
        raise InputError(
            f"{path}: found {len(first)} columns, expected {' '.join(_COLUMNS)}, or the first four"
        )
    layout = {name: place for place, name in enumerate(_COLUMNS[: len(first)])}
    rows = lines.numbers(lines.clean(text), layout.values())
    if rows is None:
        number, fault = lines.first_fault(text, layout)
        raise InputError(f"{path}:{number + 1}: {fault}")
    return _trajectory(path, rows)


def is_trajectory(rows: Iterable[Sequence[str]]) -> bool:
    """Return whether the first rows of a text are those of a trajectory with attitudes.

    Each has eight numbers, of which the first increases from row to row, and the last four are a
    quaternion of length 1.
    """
    some = list(islice(rows, _FIRST_ROWS))
    if not some or any(len(row) != len(_COLUMNS) for row in some):
        return False
    try:
        values = np.array(some, dtype=np.float64)
    except ValueError:
        return False
    # The numbers may be of any size; results are only compared.
    with np.errstate(over="ignore", invalid="ignore"):
        lengths = np.sqrt(np.square(values[:, 4:]).sum(axis=1))
        grows = (np.diff(values[:, 0]) > 0).all()
        return bool(grows and (np.abs(lengths - 1) < _ROUNDED).all())


def _trajectory(path: Path, rows: Float64) -> Trajectory:
    """Return the trajectory of rows, float64 (N, 4) or (N, 8)."""
    stamps, positions = rows[:, 0], rows[:, 1:4]
    attitudes = rows[:, 4:] if rows.shape[1] == 8 else np.ones((len(rows), 4))
    known = np.flatnonzero(are_poses(stamps, positions, attitudes))
    if not len(known):
        raise InputError(f"{path}: holds no poses, each of its {len(rows)} lines has a fault")
    notes = []
    if len(known) < len(rows):
        notes.append(
            f"{path}: {len(rows) - len(known)} of {len(rows)} lines tell no pose and are left out"
        )
    if np.abs(stamps[known]).max() >= SECONDS_BELOW:
        stamps = stamps / 1e9
        notes.append(f"{path}: the time stamps are taken as nanoseconds")
    order = in_order(stamps, known)
    return Trajectory(
        path,
        stamps[order],
        positions[order] + 0.0,
        unit(attitudes[order]) if rows.shape[1] == 8 else None,
        tuple(notes),
    )


def _text(path: Path) -> str:
    try:
        size = path.stat().st_size
        if size > _LARGEST_FILE:
            raise InputError(f"{path}: found {size:,} bytes, expected a trajectory of at most 1 GB")
        return path.read_text(encoding="utf-8-sig", errors="replace")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error


def _without_header(text: str) -> str:
    """Blank the first line that is not empty if it is a header of names."""
    rows = text.split("\n")
    for number, row in enumerate(rows):
        words = lines.fields(row)
        if words:
            if not any(lines.is_number(word) or not word for word in words):
                rows[number] = ""
            break
    return "\n".join(rows)
