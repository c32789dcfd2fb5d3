"""The interface of all sources of clouds, and the types that they yield."""

from __future__ import annotations

import math
from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple, Protocol

import numpy as np

from mlscli.keyframes.keyframe import UNKNOWN_POSITION, Axes
from mlscli.maps.georeference import Georeference
from mlscli.runtime.arrays import Array, Float64, Int64

UNKNOWN_ATTITUDE = (math.nan, math.nan, math.nan, math.nan)

KEYFRAME_FIELDS = ("keyframe", "kf", "kf_id")
"""Names of fields and channels that hold the keyframe of each point, the preferred first."""


@dataclass(frozen=True, eq=False)
class Cloud:
    """A keyframe as recorded: nothing turned, nothing dropped.

    Attributes
    ----------
    points : float64 (N, 3)
        Coordinates in the frame of the cloud, in the unit of the recording; finite or not.
    stamp : float
        Time in seconds; NaN where not known.
    position : tuple of float
        Position x, y, z of the craft, in the same frame; NaN where not known.
    frame_id : str
        The frame as the recording states it; empty where it states none.
    attitude : tuple of float
        Quaternion x, y, z, w of the craft or its camera, from its axes to that frame; NaN where
        not known.
    message : int
        The number of the message that it comes from, within a pass over its source; -1 where it
        comes from none.
    axes : {"camera", "body", "unknown"}
        Whose axes these are, see `Axes`.
    unmeasured : tuple of (str, int)
        Why points are not finite, and how many; those of which nothing more is known are left out.
    logged : float
        When it was recorded, in seconds; NaN where not known.
    is_ranged : bool
        Whether a laser measured it, as `Keyframe` has it.
    is_sifted : bool
        Whether its format says which points are no measurements, so that those are none any more.
    """

    points: Float64
    stamp: float = math.nan
    position: tuple[float, float, float] = UNKNOWN_POSITION
    frame_id: str = ""
    attitude: tuple[float, float, float, float] = UNKNOWN_ATTITUDE
    message: int = -1
    axes: Axes = "unknown"
    unmeasured: tuple[tuple[str, int], ...] = ()
    logged: float = math.nan
    is_ranged: bool = False
    is_sifted: bool = False

    @property
    def has_position(self) -> bool:
        """Whether the position of the craft is known."""
        return all(map(math.isfinite, self.position))

    @property
    def has_attitude(self) -> bool:
        """Whether the attitude of the craft or its camera is known."""
        return all(map(math.isfinite, self.attitude))


class StampedPoses(NamedTuple):
    """Poses T_parent_child of one pair of frames, in the order of the message.

    Attributes
    ----------
    stamps : float64 (N,)
        Seconds.
    translations : float64 (N, 3)
        x, y, z, in the unit of the recording.
    quaternions : float64 (N, 4)
        x, y, z, w, of length 1.
    parent, child : str
        Names of the frames, without a leading slash; `child` is empty where the message names
        none.
    refused : int
        Number of poses left out: not finite, or with a quaternion of length 0.
    topic : str
        Where it was recorded.
    logged : float
        When it was recorded, in seconds; NaN where not known.
    """

    stamps: Float64
    translations: Float64
    quaternions: Float64
    parent: str
    child: str
    refused: int = 0
    topic: str = ""
    logged: float = math.nan


@dataclass(frozen=True)
class Topic:
    """A topic of a recording.

    Attributes
    ----------
    name, type : str
    count : int or None
        Number of messages that the recording declares; None where not known before reading.
    mappable : bool
        Whether clouds can be read from it.
    why_not : str
        Why it cannot be mapped; empty where it can.
    frame : str
        The frame of its first cloud; empty where none is stated or known.
    poses : bool
        Whether its messages hold poses of the craft.
    """

    name: str
    type: str
    count: int | None
    mappable: bool
    why_not: str
    frame: str
    poses: bool = False


Clock = Literal["header", "log"]
"""Which times are used: those in the headers of messages, or those of their recording."""


class Reading(NamedTuple):
    """The user's options for reading a source.

    Attributes
    ----------
    topic : str or None
        The topic of the clouds, in formats that have topics.
    columns : str or None
        Names of the columns of a text cloud, such as ``x,y,z,-,keyframe``; None: as its header
        says, or by position.
    clock : {"header", "log"}
        Which times are used, see `Clock`.
    """

    topic: str | None = None
    columns: str | None = None
    clock: Clock = "header"


class Wanted(Protocol):
    """Called with the stamp (s) of each keyframe, in order; False skips the keyframe.

    It is called before a message is decoded, unless the stamp is known only after that. It may
    raise `PassOver`. `logged` is when the message was recorded (s), NaN where not known.
    """

    def __call__(self, stamp: float, logged: float = math.nan, /) -> bool:
        """Return whether the keyframe is wanted."""


class PassOver(Exception):  # noqa: N818  # no error: it ends a pass from within
    """Raised by a `Wanted` that wants neither this keyframe nor any after it."""


def everything(stamp: float, logged: float = math.nan) -> bool:  # noqa: ARG001
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
        """The name of the clouds in messages to the user: the path, and the topic if any."""

    @property
    def frame_id(self) -> str:
        """The frame of the first cloud; empty where none is stated."""

    @property
    def topic(self) -> str:
        """The name of the topic of its clouds; empty in formats without topics."""

    def frames(self) -> Iterator[str]:
        """Read the frames of the clouds in order, as their headers state them."""

    @property
    def expected_keyframes(self) -> int | None:
        """How many clouds to expect; None where not known before reading."""

    @property
    def notes(self) -> Sequence[str]:
        """What the user should know about how it is read."""

    @property
    def losses(self) -> Sequence[str]:
        """What the last pass could not read."""

    @property
    def georeference(self) -> Georeference | None:
        """Where on Earth its frame lies, if it says so."""

    def topics(self) -> Sequence[Topic]:
        """Return the topics; none in formats without topics."""

    def time_span(self) -> tuple[float, float]:
        """Return the first and the last time in seconds; NaN where not known."""

    def clouds(self, wanted: Wanted = everything) -> Iterator[Cloud]:
        """Read the clouds from the beginning, in order, without those whose stamp is not wanted."""

    def latest(self, wanted: Wanted = everything) -> Sequence[Cloud]:
        """Read the clouds of the last message that is wanted and can be read, if there is one.

        Of a message without a stamp, that of its first cloud counts.
        """

    def transforms(self) -> Iterator[tuple[StampedPoses, bool]]:
        """Read the transforms between frames.

        Yields
        ------
        poses : StampedPoses
        is_static : bool
            Whether they hold at all times.
        """

    def poses(self, topic: str) -> Iterator[StampedPoses]:
        """Read the poses of a topic; none where there is no such topic."""


def keyframe_field(names: Container[str]) -> str | None:
    """Return the first of `KEYFRAME_FIELDS` that is among the names; None where none is."""
    for name in KEYFRAME_FIELDS:
        if name in names:
            return name
    return None


def side_by_side(columns: Sequence[Array]) -> Float64:
    """Return arrays of N numbers each, of any dtype, as the columns of one float64 (N, columns)."""
    rows = np.empty((columns[0].size, len(columns)))
    # Signalling NaNs are no reason to warn: points that are not finite are dropped later.
    with np.errstate(invalid="ignore"):
        for number, column in enumerate(columns):
            rows[:, number] = column.reshape(-1)
    return rows


def rows_by_first_appearance(labels: Array) -> list[Int64]:
    """Return the row indices of each distinct label, in the order in which labels first appear.

    Parameters
    ----------
    labels : (N,)
        Of any dtype that can be sorted.

    Returns
    -------
    list of int64 arrays
        Ascending rows of each label; together they hold each row once.
    """
    if len(labels) and (labels == labels[0]).all():
        return [np.arange(len(labels))]
    _, first, group = np.unique(labels, return_index=True, return_inverse=True)
    place = np.empty(len(first), dtype=np.int64)
    place[np.argsort(first)] = np.arange(len(first))
    places = place[group]
    order = np.argsort(places, kind="stable")
    return np.split(order, np.cumsum(np.bincount(places))[:-1]) if len(labels) else []
