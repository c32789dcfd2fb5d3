"""What every source of clouds offers."""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple, Protocol

import numpy as np

from mlscli.keyframes.keyframe import UNKNOWN_POSITION
from mlscli.runtime.arrays import Array, Float64, Int64

UNKNOWN_ATTITUDE = (math.nan, math.nan, math.nan, math.nan)

KEYFRAME_FIELDS = ("keyframe", "kf", "kf_id")


@dataclass(frozen=True, eq=False)
class Cloud:
    """A keyframe as recorded: nothing turned, nothing dropped.

    Attributes
    ----------
    points : float64 (N, 3)
        Coordinates in the frame of the cloud, finite or not.
    stamp : float
        Time in seconds; NaN where not known.
    position : tuple of float
        Where the craft was, in the same frame; NaN where not known.
    frame_id : str
        The frame as the recording states it; empty where it states none.
    attitude : tuple of float
        How the craft or its camera was turned, x, y, z, w, from its axes to that frame; NaN where
        not known.
    """

    points: Float64
    stamp: float = math.nan
    position: tuple[float, float, float] = UNKNOWN_POSITION
    frame_id: str = ""
    attitude: tuple[float, float, float, float] = UNKNOWN_ATTITUDE

    @property
    def has_position(self) -> bool:
        """Whether it is known where the craft was."""
        return all(map(math.isfinite, self.position))


class StampedPoses(NamedTuple):
    """T_parent_child at some times, in the order of the message.

    Attributes
    ----------
    stamps : float64 (N,)
        Seconds.
    translations : float64 (N, 3)
    quaternions : float64 (N, 4)
        x, y, z, w, of length 1.
    parent, child : str
        Frames, without a leading slash; the child is empty where the message names none.
    refused : int
        Poses that were left out: not finite, or with a quaternion without length.
    """

    stamps: Float64
    translations: Float64
    quaternions: Float64
    parent: str
    child: str
    refused: int = 0


@dataclass(frozen=True)
class Topic:
    """A topic of a recording.

    Attributes
    ----------
    name, type : str
    count : int or None
        Messages, as the recording declares them; None where only reading tells.
    mappable : bool
        Whether clouds can be read from it.
    why_not : str
        What stands against it; empty where it can be mapped.
    frame : str
        The frame of its first cloud; empty where none is stated or known.
    poses : bool
        Whether it tells where the craft was.
    """

    name: str
    type: str
    count: int | None
    mappable: bool
    why_not: str
    frame: str
    poses: bool = False


Clock = Literal["header", "log"]
"""Whose times count: those in the headers of messages, or those of their recording."""


class Reading(NamedTuple):
    """What the user says of how sources are to be read.

    Attributes
    ----------
    topic : str or None
        The topic of the clouds, in formats that have topics.
    columns : str or None
        What the columns of a text cloud are, such as ``x,y,z,-,keyframe``.
    clock : {"header", "log"}
    """

    topic: str | None = None
    columns: str | None = None
    clock: Clock = "header"


Wanted = Callable[[float], bool]
"""Asked with the time stamp of each keyframe, in order, before it is decoded."""


def everything(stamp: float) -> bool:  # noqa: ARG001
    """Want every keyframe, whatever its time stamp."""
    return True


class Source(Protocol):
    """A recording, or a part of one, that yields clouds."""

    @property
    def path(self) -> Path:
        """The file or folder."""

    @property
    def kind(self) -> str:
        """The name of its format."""

    @property
    def label(self) -> str:
        """What messages to the user call the clouds: the path, and the topic if there is one."""

    @property
    def frame_id(self) -> str:
        """The frame of the first cloud; empty where none is stated."""

    @property
    def expected_keyframes(self) -> int | None:
        """How many clouds to expect; None where only reading tells."""

    @property
    def notes(self) -> Sequence[str]:
        """What the user should know about how it is read."""

    @property
    def losses(self) -> Sequence[str]:
        """What the last pass could not read."""

    def topics(self) -> Sequence[Topic]:
        """Describe the topics; none in formats without topics."""

    def time_span(self) -> tuple[float, float]:
        """Return the first and the last time in seconds; NaN where not known."""

    def clouds(self, wanted: Wanted = everything) -> Iterator[Cloud]:
        """Read the clouds anew, in order, without those whose time stamp is not wanted."""

    def transforms(self) -> Iterator[tuple[StampedPoses, bool]]:
        """Tell where frames are in others, and whether they stay there."""

    def poses(self, topic: str) -> Iterator[StampedPoses]:
        """Tell the poses of a topic; none where there is no such topic."""


def keyframe_field(names: Container[str]) -> str | None:
    """Return the name of the field or channel that tells each point's keyframe, if there is one."""
    return next((name for name in KEYFRAME_FIELDS if name in names), None)


def side_by_side(columns: Sequence[Array]) -> Float64:
    """Return columns of one shape, of any numbers, as one float64 array (N, columns)."""
    rows = np.empty((columns[0].size, len(columns)))
    # Signalling NaNs are no reason to warn: points that are not finite are dropped later.
    with np.errstate(invalid="ignore"):
        for number, column in enumerate(columns):
            rows[:, number] = column.reshape(-1)
    return rows


def rows_by_first_appearance(labels: Array) -> list[Int64]:
    """Return the rows of each distinct label, the labels in order of their first appearance.

    Parameters
    ----------
    labels : (N,)

    Returns
    -------
    list of int64 arrays
        Ascending rows; together they hold each row once.
    """
    _, first, group = np.unique(labels, return_index=True, return_inverse=True)
    place = np.empty(len(first), dtype=np.int64)
    place[np.argsort(first)] = np.arange(len(first))
    places = place[group]
    order = np.argsort(places, kind="stable")
    return np.split(order, np.cumsum(np.bincount(places))[:-1]) if len(labels) else []
