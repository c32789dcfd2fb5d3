"""A recording: one or more sources, read in turn as one flight in the map frame."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mlscli.errors import InputError, UsageError
from mlscli.io.base import Cloud, Source, Topic, Wanted
from mlscli.io.formats import open_source
from mlscli.io.selection import Selection
from mlscli.keyframes import FARTHEST, UNKNOWN_POSITION, Keyframe
from mlscli.typing import Bool, Float64
from mlscli.up import UP_AXES

WORLD_FRAMES = (
    *("map", "odom", "odom_combined", "world", "earth", "global", "origin", "local_origin"),
    *("camera_init", "vicon"),
)
"""Frames that stand still, whatever name space they are in."""


@dataclass
class Tally:
    """What a pass has read so far.

    Attributes
    ----------
    points_read : int
        Points in the keyframes selected, before any is dropped.
    dropped : dict
        How many points were dropped, by reason.
    keyframes : int
        Keyframes selected.
    """

    points_read: int = 0
    dropped: dict[str, int] = field(default_factory=dict)
    keyframes: int = 0


@dataclass(eq=False)
class Recording:
    """Sources opened to be read, as often as needed; made by `open_recording`.

    Attributes
    ----------
    frame_id : str
        The map frame; "map" where no source names one.
    notes : list of str
        What the user should know about how the sources are read.
    options : dict
        The options given that differ from their defaults, as JSON can hold them.
    tally : Tally
        Counts of the current or last pass.
    """

    _sources: Sequence[Source]
    _selection: Selection
    _up: str
    _cumulative: bool
    frame_id: str
    options: dict[str, Any] = field(default_factory=dict)
    tally: Tally = field(default_factory=Tally)

    @property
    def sources(self) -> list[str]:
        """The files and folders, in the order they are read."""
        return [str(source.path) for source in self._sources]

    @property
    def notes(self) -> list[str]:
        """What the user should know about how the sources are read."""
        return [
            note
            for source in self._sources
            for note in (*source.notes, *_frame_note(source, self.frame_id))
        ]

    @property
    def losses(self) -> list[str]:
        """What the last pass could not read."""
        return [loss for source in self._sources for loss in source.losses]

    @property
    def expected_keyframes(self) -> int | None:
        """How many keyframes a pass will yield; None where only reading tells."""
        if self._selection.by_time:
            return None
        total = 0
        for source in self._sources:
            expected = source.expected_keyframes
            if expected is None:
                return None
            total += expected
        return -(-total // self._selection.every)

    def keyframes(self) -> Iterator[Keyframe]:
        """Read the keyframes from the first to the last; each call begins anew.

        Yields
        ------
        Keyframe
            One without points too, where all were dropped.

        Raises
        ------
        InputError
            A source is broken, or the pass has ended without a point.
        UsageError
            Times are asked for where there are none.
        """
        self.tally = tally = Tally()
        axes, signs = UP_AXES[self._up]
        filters = self._filters()
        wanted = self._selection.chooser()
        clouds = (cloud for source in self._sources for cloud in self._clouds(source, wanted))
        for number, cloud in enumerate(clouds):
            if number % self._selection.every:
                continue
            tally.keyframes += 1
            tally.points_read += len(cloud.points)
            points = np.take(cloud.points, axes, axis=1) * signs + 0.0
            for reason, keeps in filters:
                kept = keeps(points)
                dropped = len(points) - int(np.count_nonzero(kept))
                if dropped:
                    tally.dropped[reason] = tally.dropped.get(reason, 0) + dropped
                    points = points[kept]
            yield Keyframe(points, cloud.stamp, _turned(cloud.position, self._up))
        if tally.points_read == sum(tally.dropped.values()):
            raise InputError(self._emptiness())

    def _clouds(self, source: Source, wanted: Wanted) -> Iterator[Cloud]:
        """Yield the clouds of a source that are in the map frame; refuse any other."""
        for cloud in source.clouds(wanted):
            frame = _bare(cloud.frame_id)
            if frame and frame != self.frame_id:
                raise _other_frame(source, frame, self.frame_id)
            yield cloud

    def _filters(self) -> list[tuple[str, Callable[[Float64], Bool]]]:
        """Return why points are dropped, in the order asked, and which are kept."""
        filters: list[tuple[str, Callable[[Float64], Bool]]] = [
            ("not finite", lambda points: _on_all_axes(np.isfinite(points))),
            ("beyond 1e8", lambda points: _on_all_axes(np.abs(points) <= FARTHEST)),
        ]
        if self._selection.crop is not None:
            low, high = np.array(self._selection.crop, dtype=np.float64).reshape(3, 2).T
            filters.append(
                (
                    "outside the crop",
                    lambda points: _on_all_axes((low <= points) & (points <= high)),
                )
            )
        if self._cumulative:
            from mlscli.io.seen import SeenPoints

            filters.append(("repeated", SeenPoints().add))
        return filters

    def _emptiness(self) -> str:
        """Say why a pass has yielded no points."""
        tally, sources = self.tally, ", ".join(self.sources)
        losses = "".join(f"; {loss}" for loss in self.losses)
        if not tally.keyframes:
            where = " between --start and --end" if self._selection.by_time else ""
            return f"{sources}: holds no keyframes{where}{losses}"
        reasons = ", ".join(f"{count:,} {reason}" for reason, count in tally.dropped.items())
        dropped = f" to map: all {tally.points_read:,} were dropped, {reasons}" if reasons else ""
        return f"{sources}: holds no points{dropped}{losses}"


def open_recording(
    *sources: str | os.PathLike[str],
    topic: str | None = None,
    columns: str | None = None,
    start: float | None = None,
    end: float | None = None,
    every: int = 1,
    crop: Sequence[float] | None = None,
    up: str = "z",
    cumulative: bool = False,
    frame: str | None = None,
) -> Recording:
    """Open one or more sources as one recording.

    Parameters
    ----------
    *sources : paths
        Read in turn; their formats are told by content.
    topic : str, optional
        The topic of the clouds in bags that have several.
    columns : str, optional
        What the columns of text clouds are: ``x,y,z,-,keyframe,cx,cy,cz``.
    start, end : float, optional
        Seconds from the first keyframe if below 1e8, else as the time stamps count; inclusive.
    every : int
        Take keyframes 0, N, 2 N, ... of those between `start` and `end`.
    crop : six floats, optional
        xmin, xmax, ymin, ymax, zmin, zmax in the map frame, inclusive.
    up : str
        Which axis of the recording points up: z, -z, y, -y, x or -x.
    cumulative : bool
        Take a point only where its coordinates come for the first time.
    frame : str, optional
        The map frame; clouds in it are taken as they are.

    Raises
    ------
    UsageError
        An option is out of range, or fits no source, or the topic is ambiguous.
    InputError
        A source is missing, broken, of no known format, or not in the map frame.
    """
    selection = Selection(start, end, every, crop)
    if up not in UP_AXES:
        raise UsageError(f"--up {up}: expected one of {', '.join(UP_AXES)}")
    if frame is not None and not _bare(frame):
        raise UsageError("--frame: expected the name of the map frame, found nothing")
    if not sources:
        raise UsageError("no source given: expected at least one recording")
    opened = [open_source(Path(source), topic, columns) for source in sources]
    _check_applies("--topic", topic, [bool(source.topics()) for source in opened], "a bag")
    _check_applies(
        "--columns", columns, [source.kind == "text cloud" for source in opened], "a text cloud"
    )
    given = {
        "topic": topic,
        "columns": columns,
        "start": start,
        "end": end,
        "every": every if every != 1 else None,
        "crop": None if crop is None else list(crop),
        "up": up if up != "z" else None,
        "cumulative": cumulative or None,
        "frame": frame,
    }
    options = {name: value for name, value in given.items() if value is not None}
    return Recording(opened, selection, up, cumulative, _map_frame(opened, frame), options)


def why_not_mapped(topic: Topic) -> str:
    """Say what stands against mapping a topic; nothing where it can be mapped as it is."""
    frame = _bare(topic.frame)
    if topic.mappable and frame and not _is_world(frame):
        return f"frame {frame!r} is no world frame; where it stands still, say --frame {frame}"
    return topic.why_not


def _on_all_axes(holds: Bool) -> Bool:
    return np.asarray(holds.all(axis=1))


def _turned(position: tuple[float, float, float], up: str) -> tuple[float, float, float]:
    """Turn a position like the points; unknown where one coordinate is not finite."""
    if not np.isfinite(position).all():
        return UNKNOWN_POSITION
    axes, signs = UP_AXES[up]
    x, y, z = (position[axis] * sign + 0.0 for axis, sign in zip(axes, signs, strict=True))
    return x, y, z


def _bare(frame: str) -> str:
    return frame.strip().lstrip("/")


def _is_world(frame: str) -> bool:
    return frame.rpartition("/")[2] in WORLD_FRAMES


def _map_frame(sources: Sequence[Source], declared: str | None) -> str:
    """Return the frame declared, or else the world frame that the first source states."""
    if declared is not None:
        return _bare(declared)
    for source in sources:
        frame = _bare(source.frame_id)
        if frame:
            if not _is_world(frame):
                raise _other_frame(source, frame, None)
            return frame
    return "map"


def _other_frame(source: Source, frame: str, map_frame: str | None) -> InputError:
    if map_frame is None:
        expected = (
            f"a world frame ({', '.join(WORLD_FRAMES)}); clouds that move with a sensor cannot be "
            f"mapped, but where {frame!r} stands still, --frame {frame} says so"
        )
    else:
        expected = f"the map frame {map_frame!r}"
    return InputError(f"{source.label}: the clouds are in the frame {frame!r}, expected {expected}")


def _frame_note(source: Source, map_frame: str) -> list[str]:
    """Say in which frame clouds were taken as they are, where there are frames at all."""
    if not source.topics():
        return []
    frame = _bare(source.frame_id)
    if frame and frame != map_frame:
        return []
    stated = f"are in the frame {frame!r}" if frame else "state no frame"
    return [f"{source.label}: the clouds {stated} and are taken as they are"]


def _check_applies(option: str, value: object, applies: Sequence[bool], what: str) -> None:
    if value is not None and not any(applies):
        raise UsageError(f"{option} {value}: no source is {what}")
