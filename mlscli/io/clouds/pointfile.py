"""What files of points share: they have no topics or frames, and are read once and held whole."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mlscli.errors import InputError
from mlscli.io.plausibility.counts import count_of
from mlscli.io.plausibility.degrees import are_lengths
from mlscli.io.plausibility.heights import have_heights
from mlscli.io.source import (
    Cloud,
    StampedPoses,
    Topic,
    Wanted,
    everything,
    keyframe_field,
    rows_by_first_appearance,
    side_by_side,
)
from mlscli.keyframes.keyframe import UNKNOWN_POSITION
from mlscli.maps.georeference import Georeference
from mlscli.runtime.arrays import Array, Float64
from mlscli.words import are, some

_LOOKED_AT = 10_000
"""Points whose coordinates are looked at."""


class Content(NamedTuple):
    """The content of a file of points.

    Attributes
    ----------
    clouds : sequence of Cloud
        The keyframes, in order.
    notes : sequence of str
        What the user should know about how the file was read.
    losses : sequence of str
        What could not be read.
    stamps : float64 (N,)
        All times in seconds, in any order; NaN where not known.
    georeference : Georeference or None
        Where on Earth its frame lies, if it says so.
    """

    clouds: Sequence[Cloud]
    notes: Sequence[str] = ()
    losses: Sequence[str] = ()
    stamps: Float64 = np.empty(0)
    georeference: Georeference | None = None


class PointFile(ABC):
    """A source that is one file or folder of points.

    Parameters
    ----------
    path : Path
        Read when its content is first asked for.
    notes : sequence of str
        What the user should know about how it was found.
    """

    kind: str
    frame_id = ""
    topic = ""

    def __init__(self, path: Path, notes: Sequence[str] = ()) -> None:
        self.path = path
        self._found = notes

    @abstractmethod
    def _read(self) -> Content:
        """Read the file."""

    @property
    def label(self) -> str:
        """The path."""
        return str(self.path)

    @property
    def notes(self) -> Sequence[str]:
        """What the user should know about how it is read."""
        return [*self._found, *self._content.notes]

    @property
    def losses(self) -> Sequence[str]:
        """What could not be read."""
        return self._content.losses

    @property
    def expected_keyframes(self) -> int:
        """How many keyframes it holds."""
        return len(self._content.clouds)

    @property
    def georeference(self) -> Georeference | None:
        """Where on Earth its frame lies, if it says so."""
        return self._content.georeference

    def frames(self) -> Iterator[str]:
        """Yield nothing: such files state no frames."""
        return iter(())

    def topics(self) -> Sequence[Topic]:
        """Return nothing: such files have no topics."""
        return ()

    def time_span(self) -> tuple[float, float]:
        """Return the first and the last time in seconds; NaN where none is known."""
        stamps = self._content.stamps
        known = stamps[np.isfinite(stamps)]
        return (float(known.min()), float(known.max())) if len(known) else (math.nan, math.nan)

    def clouds(self, wanted: Wanted = everything) -> Iterator[Cloud]:
        """Yield the cloud of each keyframe."""
        return (cloud for cloud in self._content.clouds if wanted(cloud.stamp))

    def latest(self, wanted: Wanted = everything) -> Sequence[Cloud]:  # noqa: ARG002
        """Return nothing: such files have no messages."""
        return ()

    def transforms(self) -> Iterator[tuple[StampedPoses, bool]]:
        """Yield nothing: clouds and positions of one file are in one frame."""
        return iter(())

    def poses(self, topic: str) -> Iterator[StampedPoses]:  # noqa: ARG002
        """Yield nothing: such files have no topics."""
        return iter(())

    @cached_property
    def _content(self) -> Content:
        try:
            content = self._read()
        except OSError as error:
            raise InputError(f"{self.path}: cannot be read: {error.strerror or error}") from error
        note = _doubt(content.clouds)
        return content._replace(notes=[*content.notes, f"{self.path}: {note}"]) if note else content


def _doubt(clouds: Sequence[Cloud]) -> str:
    """Return what is doubtful about the coordinates of all clouds; empty where nothing is."""
    total = sum(len(cloud.points) for cloud in clouds)
    some = [cloud.points[:: total // _LOOKED_AT + 1] for cloud in clouds]
    points = np.concatenate(some) if some else np.empty((0, 3))
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return ""
    found = are_lengths(points.min(axis=0), points.max(axis=0)), have_heights(points)
    return "; ".join(each.note for each in found if each.note)


def wanted_fields(path: Path, names: Iterable[str]) -> list[int] | None:
    """Return the indices of x, y, z and, if any, the keyframe; None where x, y or z is missing.

    Parameters
    ----------
    path : Path
        The file, to be named.
    names : iterable of str
        Names of all fields, empty for fields that are no number. Case does not matter; of several
        equal names the first counts.

    Raises
    ------
    InputError
        They are those of poses, as LIO-SAM and its kin keep theirs beside the cloud.
    """
    places = {name.lower(): place for place, name in reversed(list(enumerate(names)))}
    if not places.keys() >= {"x", "y", "z"}:
        return None
    if places.keys() >= {"roll", "pitch", "yaw"}:
        raise InputError(
            f"{path}: holds poses (x, y, z, roll, pitch, yaw) and no points; name the cloud instead"
        )
    keyframe = keyframe_field(places)
    return [places[name] for name in ("x", "y", "z", keyframe) if name is not None]


def by_keyframe(
    points: Float64,
    labels: Array | None,
    position: tuple[float, float, float] = UNKNOWN_POSITION,
) -> list[Cloud]:
    """Return a cloud for each keyframe, in order of first appearance.

    Parameters
    ----------
    points : float64 (N, 3)
    labels : (N,) or None
        The keyframe of each point; None: all points are one keyframe.
    position : tuple of float
        Position x, y, z of the craft, in all of them.
    """
    if labels is None or not len(points):
        return [Cloud(points, position=position)]
    return [Cloud(points[rows], position=position) for rows in rows_by_first_appearance(labels)]


class Counted(NamedTuple):
    """The points of a file of which the header declares a number.

    Attributes
    ----------
    columns : list of arrays (N,)
        The wanted columns of those that count.
    notes, losses : list of str
        What is said of the number.
    """

    columns: list[Array]
    notes: list[str]
    losses: list[str]


def counted(path: Path, columns: list[Array], declared: int, fault: str = "") -> Counted:
    """Compare the points that are there with the number declared.

    Parameters
    ----------
    path : Path
    columns : list of arrays (N,)
        The wanted columns of all whole records there are, x, y and z first.
    declared : int
    fault : str
        What is wrong with those that are missing; see `shortfall`.
    """
    there = len(columns[0])
    if there < declared:
        return Counted(columns, [], [shortfall(path, there, declared, fault)])
    if there == declared:
        return Counted(columns, [], [])
    found = count_of(side_by_side(columns[:3]), declared)
    count = declared if found.value is None else found.value
    return Counted(
        [column[:count] for column in columns],
        [f"{path}: {found.note}"] if found.note else [],
        [f"{path}: {found.refusal}"] if found.refusal else [],
    )


def shortfall(path: Path, came: int, declared: int, fault: str = "", what: str = "point") -> str:
    """Return a line that says how many of the points declared are missing, and why.

    Parameters
    ----------
    path : Path
    came, declared : int
        Number of points read, and of points declared.
    fault : str
        What is wrong with the missing ones; empty where the file ends before them.
    what : str
        What one of them is, where it is no point.
    """
    lost = declared - came
    why = fault or "the file ends before them"
    return f"{path}: {lost:,} of {some(declared, what)} {are(lost)} missing: {why}"
