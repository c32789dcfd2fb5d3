"""The result of every decoder of clouds, and what decoders share."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import wraps
from typing import Any, NamedTuple, ParamSpec, TypeVar

import numpy as np

from mlscli.errors import one_line
from mlscli.geometry.poses import Pose, apply
from mlscli.io.ros import NANOSECONDS
from mlscli.io.source import rows_by_first_appearance, side_by_side
from mlscli.runtime.arrays import Array, Float64


class MalformedCloudError(ValueError):
    """A message contradicts itself or lacks a field; one line states what was found."""

    def __init__(self, words: str) -> None:
        super().__init__(one_line(words))


class CloudPart(NamedTuple):
    """Points of a message that are in one frame at one time.

    Attributes
    ----------
    points : float64 (N, 3)
        Coordinates in the unit of the recording; NaN where nothing was measured.
    keyframes : (N,) or None
        The keyframe of each point, of any dtype; None where the message has no such field.
    frame_id : str
        As recorded; empty where none is stated.
    stamp : float
        Time in seconds; NaN where none is stated.
    skipped : int
        Number of markers that hold no points, such as text.
    doubts : tuple of str
        What of the message contradicts its data, and what counts instead; see `Finding.note`.
    unmeasured : tuple of (str, int)
        Why points are NaN, and how many; those of which nothing more is known are left out.
    is_ranged : bool
        Whether a laser measured it.
    is_sifted : bool
        Whether all that is no measurement is NaN, as ranges tell it.
    """

    points: Float64
    keyframes: Array | None = None
    frame_id: str = ""
    stamp: float = math.nan
    skipped: int = 0
    doubts: tuple[str, ...] = ()
    unmeasured: tuple[tuple[str, int], ...] = ()
    is_ranged: bool = False
    is_sifted: bool = False

    def split(self) -> list[Float64]:
        """Return the points (N, 3) of each keyframe, in order of first appearance."""
        if self.keyframes is None or not len(self.points):
            return [self.points]
        return [self.points[rows] for rows in rows_by_first_appearance(self.keyframes)]


def part_of(
    points: Float64, frame_id: Any, time: Any, keyframes: Array | None = None, skipped: int = 0
) -> CloudPart:
    """Return points (N, 3) with their frame and time as the message states them.

    Raises
    ------
    MalformedCloudError
        The points are not (N, 3), or the frame is no text.
    """
    if not isinstance(frame_id, str):
        raise MalformedCloudError(f"frame {str(frame_id)[:50]!r}, expected text")
    if points.ndim != 2 or points.shape[1] != 3:
        raise MalformedCloudError(f"coordinates of shape {points.shape}, expected (N, 3)")
    return CloudPart(points, keyframes, frame_id, seconds(time), skipped)


def seconds(time: Any) -> float:
    """Return a time of ROS, protobuf or json in seconds."""
    if hasattr(time, "seconds"):
        whole, nanoseconds = time.seconds, time.nanos
    else:
        whole, nanoseconds = time.sec, time.nanosec if hasattr(time, "nanosec") else time.nsec
    # As integers: in json they may be text, and text times a number is a long text.
    return (int(whole) * NANOSECONDS + int(nanoseconds)) / NANOSECONDS


def vectors(structures: Array) -> Float64:
    """Return the fields x, y, z of a structured array (N,) as float64 (N, 3)."""
    return side_by_side([structures[name] for name in "xyz"])


def placed(points: Float64, pose: Any) -> Float64:
    """Move points (N, 3) by the pose that their message states.

    A quaternion of zeros, as in a pose that was never set, turns nothing, as in RViz. One that is
    not finite makes all points NaN.
    """
    turn, shift = pose.orientation, pose.position
    quaternion = np.array([turn.x, turn.y, turn.z, turn.w], dtype=np.float64)
    length = np.sqrt(np.square(quaternion).sum())
    if not np.isfinite(length):
        return np.full_like(points, np.nan)
    translation = np.array([shift.x, shift.y, shift.z], dtype=np.float64)
    return apply(Pose(translation, quaternion), points)


_P = ParamSpec("_P")
_R = TypeVar("_R")


def checked(type_: str, decode: Callable[_P, _R]) -> Callable[_P, _R]:
    """Return a decoder that raises `MalformedCloudError` where a message does not fit its type.

    Definitions are recorded beside messages, and json has none: a field can be missing or be of
    another kind than that of the type.
    """

    @wraps(decode)
    def decode_checked(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        try:
            # No warnings of values that are not finite: they are dropped later, and counted.
            with np.errstate(all="ignore"):
                return decode(*args, **kwargs)
        except MalformedCloudError:
            raise
        except AttributeError as error:
            raise MalformedCloudError(
                f"is not laid out as {type_} is: a field {error.name} is missing"
            ) from error
        except (ArithmeticError, LookupError, TypeError, ValueError) as error:
            raise MalformedCloudError(f"is not laid out as {type_} is: {error}") from error

    return decode_checked
