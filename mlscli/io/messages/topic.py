"""The clouds of one topic of a container, and the transforms and poses of the container."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from mlscli.errors import UsageError
from mlscli.io.containers.container import Container, Message
from mlscli.io.messages.choice import NO_TYPE, beside, choose, same
from mlscli.io.messages.decoding import Deserializer, MalformedMessageError
from mlscli.io.messages.poses import POSE_TYPES, TRANSFORM_TYPES, PoseRow, stamped
from mlscli.io.messages.registry import CLOUD_TYPES, MAPPABLE, CloudPart, MalformedCloudError
from mlscli.io.ros import NANOSECONDS
from mlscli.io.source import Clock, Cloud, PassOver, StampedPoses, Topic, Wanted, everything
from mlscli.words import some

_Read: TypeAlias = tuple[str, float, list[PoseRow]]
# The topic of a message, when it was recorded (s), and its poses.

_TOGETHER = 4096
"""So many poses are made into arrays together."""


class TopicSource:
    """A topic of a container; each pass reads its clouds again and never holds them all.

    Parameters
    ----------
    container : Container
    topic : str, optional
        The topic of the clouds; not needed where only one has clouds.
    clock : {"header", "log"}
        Which times are used, see `Clock`.
    """

    def __init__(
        self, container: Container, topic: str | None = None, clock: Clock = "header"
    ) -> None:
        self._container = container
        self._asked = topic
        self._clock = clock
        self._deserializer = Deserializer()
        self._split: set[str] = set()
        self._came = self._lost = 0
        self._first_fault = ""
        self._lost_beside: dict[str, None] = {}
        self._beside: Sequence[str] = ()
        self._refused: Counter[str] = Counter()
        self._skipped = 0
        self._doubts: Counter[str] = Counter()
        self._first_doubts: dict[str, Sequence[str]] = {}
        self._topics = self._describe()

    @property
    def path(self) -> Path:
        """The file or folder."""
        return self._container.path

    @property
    def kind(self) -> str:
        """The name of its format."""
        return self._container.kind

    @property
    def label(self) -> str:
        """The path and the topic."""
        return f"{self.path}: {self._topic.name}"

    @property
    def frame_id(self) -> str:
        """The frame of the first cloud; empty where none is stated."""
        return self._topic.frame

    @property
    def topic(self) -> str:
        """The name of the topic of the clouds."""
        return self._topic.name

    @property
    def georeference(self) -> None:
        """Nothing: messages of clouds do not say where on Earth they lie."""

    def frames(self) -> Iterator[str]:
        """Read the frames of the clouds in order; a message is decoded if it does not begin so."""
        topic = self._topic
        for message in self._messages((topic.type,), topic.name):
            if frame := self._deserializer.frame(message):
                yield frame
                continue
            try:
                yield from (part.frame_id for part in self._decode(message))
            except (MalformedMessageError, MalformedCloudError):
                continue

    @property
    def expected_keyframes(self) -> int | None:
        """The number of messages of the topic; None where each may hold several keyframes."""
        return None if self._topic.name in self._split else self._topic.count

    @property
    def notes(self) -> Sequence[str]:
        """What the user should know about how it is read."""
        notes = [*self._container.notes, *self._beside]
        if self._skipped:
            notes.append(f"{self.label}: {some(self._skipped, 'marker')} of kinds without points")
        notes += [
            f"{self.label}: in {count:,} of {some(self._came, 'message')}, {doubt}"
            for doubt, count in self._doubts.items()
        ]
        notes += [
            f"{self.path}: {name}: {some(count, 'pose')} left out, not finite or with "
            "a quaternion of no length"
            for name, count in self._refused.items()
        ]
        return notes

    @property
    def losses(self) -> Sequence[str]:
        """What the last pass over clouds, and any pass over transforms or poses, could not read."""
        of_clouds = list(self._container.losses)
        if self._lost:
            of_clouds.append(
                f"{self.label}: {self._lost:,} of {some(self._came, 'message')} cannot be read, "
                f"{self._first_fault}"
            )
        return list(self._lost_beside | dict.fromkeys(of_clouds))

    @property
    def first_doubts(self) -> Sequence[str]:
        """What the first messages of the topics contradict themselves in; see `Finding.note`."""
        return [
            f"{self.path}: {topic}: in the first message, {doubt}"
            for topic, doubts in self._first_doubts.items()
            for doubt in doubts
        ]

    def topics(self) -> Sequence[Topic]:
        """Return all topics, sorted by name."""
        return self._topics

    def time_span(self) -> tuple[float, float]:
        """Return when the first and the last message were recorded, in seconds."""
        span = self._container.time_span
        if span is None:
            return math.nan, math.nan
        return span[0] / NANOSECONDS, span[1] / NANOSECONDS

    def clouds(self, wanted: Wanted = everything) -> Iterator[Cloud]:
        """Read the clouds of the topic in the order of their recording.

        Messages that cannot be read are left out, and reported in `losses` when the pass ends.

        Raises
        ------
        InputError
            No topic has clouds.
        UsageError
            Several topics have clouds and none was chosen, or the one chosen cannot be mapped.
        """
        for number, message in self._pass():
            stamp = self._stamp(message)
            if math.isnan(stamp):
                yield from self._clouds_of(number, message, wanted)
            elif wanted(stamp, _logged(message)):
                yield from self._clouds_of(number, message)

    def latest(self, wanted: Wanted = everything) -> Sequence[Cloud]:
        """Read the clouds of the last message of the topic that is wanted and can be read.

        Only that one is decoded, if messages begin with their time and it is not broken.

        Raises
        ------
        InputError, UsageError
            As for `clouds`.
        """
        chosen: set[int] = set()
        last: tuple[int, Message] | None = None
        with suppress(PassOver):
            for number, message in self._pass():
                stamp = self._stamp(message)
                if math.isnan(stamp):
                    parts = self._parts(message)
                    if not parts:
                        continue
                    stamp = parts[0].stamp
                if wanted(stamp, _logged(message)):
                    chosen.add(number)
                    last = number, message
        if last is None:
            return []
        came, lost, self._skipped = self._came, self._lost, 0
        clouds = self._clouds_of(*last)
        if self._lost > lost:
            # Of those before, the last one that can be read is found by reading all of them.
            for number, message in self._pass():
                if number in chosen:
                    clouds = self._clouds_of(number, message) or clouds
                if number == last[0]:
                    break
            self._came = came
        return clouds

    def _pass(self) -> Iterator[tuple[int, Message]]:
        """Begin a pass over the messages of the topic, and number them."""
        self._came = self._lost = self._skipped = 0
        self._first_fault = ""
        topic = self._topic
        self._doubts.clear()
        for number, message in enumerate(self._messages((topic.type,), topic.name)):
            self._came += 1
            yield number, message

    def _clouds_of(self, number: int, message: Message, wanted: Wanted = everything) -> list[Cloud]:
        """Return the clouds of a message, without those whose stamp is not wanted."""
        stamp, logged = self._stamp(message), _logged(message)
        clouds = []
        for part in self._parts(message):
            time = part.stamp if math.isnan(stamp) else stamp
            if wanted(time, logged):
                told = part.unmeasured
                clouds += [
                    Cloud(
                        points,
                        time,
                        frame_id=part.frame_id,
                        message=number,
                        unmeasured=told,
                        logged=logged,
                        is_ranged=part.is_ranged,
                        is_sifted=part.is_sifted,
                    )
                    for points in part.split()
                ]
        return clouds

    def _parts(self, message: Message) -> list[CloudPart]:
        """Decode a message; one that cannot be read is counted, and has no parts."""
        try:
            parts = self._decode(message)
        except (MalformedMessageError, MalformedCloudError) as error:
            self._lost += 1
            at = f"the first at {self._stamp(message):.9f}"
            self._first_fault = self._first_fault or f"{at}: {error}"
            return []
        self._skipped += sum(part.skipped for part in parts)
        self._doubts.update(_doubts(parts))
        return parts

    def transforms(self) -> Iterator[tuple[StampedPoses, bool]]:
        """Read the transforms of all topics, each with whether its topic is a ``tf_static``.

        Messages that cannot be read are left out, and reported in `losses` when the pass ends.
        """
        for poses in self._read_poses(TRANSFORM_TYPES):
            yield poses, poses.topic.rpartition("/")[2] == "tf_static"

    def poses(self, topic: str) -> Iterator[StampedPoses]:
        """Read the poses of a topic; none where there is no such topic.

        Raises
        ------
        UsageError
            The type of the topic's messages holds no poses.
        """
        named = [c for c in self._container.channels if same(c.topic, topic)]
        if named and not any(channel.type in POSE_TYPES for channel in named):
            raise UsageError(
                f"{self.path}: `pose_topic` {topic}: {named[0].type} tells no poses; can be used: "
                f"{', '.join(POSE_TYPES)}"
            )
        yield from self._read_poses(POSE_TYPES, topic)

    # --- messages ---

    def _messages(self, types: Collection[str], topic: str | None = None) -> Iterator[Message]:
        """Read the messages of these types, of one topic or of all."""
        names = {
            channel.topic
            for channel in self._container.channels
            if channel.type in types and (topic is None or same(channel.topic, topic))
        }
        if names:
            messages = self._container.messages(names)
            yield from (m for m in messages if m.channel.type in types)

    def _stamp(self, message: Message) -> float:
        if self._clock == "log":
            return _logged(message)
        return self._deserializer.stamp(message)

    def _decode(self, message: Message) -> list[CloudPart]:
        return CLOUD_TYPES[message.channel.type](self._deserializer.read(message))

    def _read_poses(
        self, types: Mapping[str, Callable[[Any], list[PoseRow]]], topic: str | None = None
    ) -> Iterator[StampedPoses]:
        """Read the poses of messages of these types, of one topic or of all."""
        unreadable: Counter[str] = Counter()
        refused: Counter[str] = Counter()
        together: list[_Read] = []
        rows = 0
        try:
            for message in self._messages(types, topic):
                try:
                    found = types[message.channel.type](self._deserializer.read(message))
                except (MalformedMessageError, MalformedCloudError):
                    unreadable[message.channel.topic] += 1
                    continue
                together.append((message.channel.topic, _logged(message), found))
                rows += 1 + len(found)
                if rows >= _TOGETHER:
                    yield from self._stamped(together, refused)
                    together, rows = [], 0
            yield from self._stamped(together, refused)
        finally:
            lost = [
                f"{self.path}: {name}: {some(count, 'message')} cannot be read"
                for name, count in unreadable.items()
            ]
            self._refused |= +refused
            self._lost_beside |= dict.fromkeys([*self._container.losses, *lost])

    def _stamped(self, read: Sequence[_Read], refused: Counter[str]) -> Iterator[StampedPoses]:
        """Yield the poses of messages, and count those that are refused, by topic."""
        tables = stamped([rows for *_, rows in read])
        for (topic, logged, _), found in zip(read, tables, strict=True):
            for poses in found:
                refused[topic] += poses.refused
                if self._clock == "log":
                    poses = poses._replace(stamps=np.full(len(poses.stamps), logged))
                yield poses._replace(topic=topic, logged=logged)

    # --- topics ---

    @cached_property
    def _topic(self) -> Topic:
        """The topic of the clouds."""
        damage = "".join(f"; {loss}" for loss in self._container.losses)
        chosen = choose(self.path, self._topics, self._asked, damage)
        self._beside = beside(self.path, chosen, self._topics)
        return chosen

    def _describe(self) -> list[Topic]:
        """Return all topics; the frame of clouds is that of their first message."""
        counts: dict[tuple[str, str], list[int | None]] = {}
        faults: dict[tuple[str, str], str] = {}
        for channel in self._container.channels:
            key = (channel.topic, channel.type)
            counts.setdefault(key, []).append(channel.count)
            if channel.type in CLOUD_TYPES and (fault := self._deserializer.why_not(channel)):
                faults.setdefault(key, fault)
        topics = []
        for (name, type_), parts in sorted(counts.items()):
            count = None if None in parts else sum(filter(None, parts))
            why_not, frame = faults.get((name, type_), ""), ""
            if type_ not in CLOUD_TYPES:
                why_not = f"{type_ or NO_TYPE} cannot be mapped; can be mapped: {MAPPABLE}"
            elif not why_not:
                first = next(self._messages((type_,), name), None)
                if first is None:
                    why_not = "it holds no messages"
                else:
                    frame = self._first_frame(first)
            poses = type_ in POSE_TYPES
            topics.append(Topic(name, type_, count, not why_not, why_not, frame, poses))
        return topics

    def _first_frame(self, first: Message) -> str:
        try:
            parts = self._decode(first)
        except (MalformedMessageError, MalformedCloudError) as error:
            # It is reported when all are read; others may be right.
            self._first_doubts[first.channel.topic] = [f"nothing can be read: {error}"]
            return self._deserializer.frame(first)
        self._first_doubts[first.channel.topic] = _doubts(parts)
        if len(parts) != 1 or parts[0].keyframes is not None:
            self._split.add(first.channel.topic)
        return parts[0].frame_id if parts else ""


def _doubts(parts: Sequence[CloudPart]) -> list[str]:
    """Return what a message contradicts itself in, each once."""
    return list(dict.fromkeys(doubt for part in parts for doubt in part.doubts))


def _logged(message: Message) -> float:
    """Return when a message was recorded, in seconds."""
    return message.log_time / NANOSECONDS
