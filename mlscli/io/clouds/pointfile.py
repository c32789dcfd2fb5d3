"""What files of points have in common: no topics, no frames, read once and then held whole."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mlscli.errors import InputError
from mlscli.io.source import (
    Cloud,
    StampedPoses,
    Topic,
    Wanted,
    everything,
    keyframe_field,
    rows_by_first_appearance,
)
from mlscli.keyframes.keyframe import UNKNOWN_POSITION
from mlscli.runtime.arrays import Array, Float64


class Content(NamedTuple):
    """What a file holds: its keyframes in order, and what the user should know of them.

    Attributes
    ----------
    clouds, notes, losses
        As a source offers them.
    stamps : float64 (N,)
        All times in seconds, in any order; NaN where not known.
    """

    clouds: Sequence[Cloud]
    notes: Sequence[str] = ()
    losses: Sequence[str] = ()
    stamps: Float64 = np.empty(0)


class PointFile(ABC):
    """A source that is one file or folder of points.

    Parameters
    ----------
    path : Path
        Read when its content is first asked for.
    """

    kind: str
    frame_id = ""

    def __init__(self, path: Path) -> None:
        self.path = path

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
        return self._content.notes

    @property
    def losses(self) -> Sequence[str]:
        """What could not be read."""
        return self._content.losses

    @property
    def expected_keyframes(self) -> int:
        """How many keyframes it holds."""
        return len(self._content.clouds)

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

    def transforms(self) -> Iterator[tuple[StampedPoses, bool]]:
        """Tell nothing: clouds and positions of one file are in one frame."""
        return iter(())

    def poses(self, topic: str) -> Iterator[StampedPoses]:  # noqa: ARG002
        """Tell nothing: such files have no topics."""
        return iter(())

    @cached_property
    def _content(self) -> Content:
        try:
            return self._read()
        except OSError as error:
            raise InputError(f"{self.path}: cannot be read: {error.strerror or error}") from error


def wanted_fields(names: Iterable[str]) -> list[int] | None:
    """Return the places of x, y, z and, where there is one, the keyframe; None where x, y, z lack.

    Of names alike, in capitals or not, the first counts; what is no number has an empty one.
    """
    places = {name.lower(): place for place, name in reversed(list(enumerate(names)))}
    if not places.keys() >= {"x", "y", "z"}:
        return None
    keyframe = keyframe_field(places)
    return [places[name] for name in ("x", "y", "z", keyframe) if name is not None]


def by_keyframe(
    points: Float64,
    labels: Array | None,
    position: tuple[float, float, float] = UNKNOWN_POSITION,
) -> list[Cloud]:
    """Return a cloud for each distinct label, in order of first appearance; without labels one."""
    if labels is None or not len(points):
        return [Cloud(points, position=position)]
    return [Cloud(points[rows], position=position) for rows in rows_by_first_appearance(labels)]


def shortfall(path: Path, came: int, declared: int, fault: str = "", what: str = "points") -> str:
    """Say how many of the points declared are missing, and why."""
    why = fault or "the file ends before them"
    return f"{path}: {declared - came:,} of {declared:,} {what} are missing: {why}"
