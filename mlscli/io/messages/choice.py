"""Which of the topics of a recording has its clouds: the one asked for, or the only one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mlscli.errors import InputError, UsageError
from mlscli.io.messages.registry import CLOUD_TYPES, MAPPABLE
from mlscli.io.source import Topic

NO_TYPE = "no type"
"""What stands for the type of a channel without a schema."""


def choose(path: Path, topics: Sequence[Topic], asked: str | None, damage: str) -> Topic:
    """Return the topic of the clouds; of the types of one topic that with most messages.

    Parameters
    ----------
    path : Path
        The recording.
    topics : sequence of Topic
        A topic with messages of several types is there several times.
    asked : str or None
        The name that is asked for; None: the only one with clouds.
    damage : str
        What is lost of the recording, a possible reason why a topic is missing.

    Raises
    ------
    InputError, UsageError
        Where there is none, or more than one.
    """
    named = [topic for topic in topics if asked is None or same(topic.name, asked)]
    mappable = [topic for topic in named if topic.mappable]
    if asked is not None and not named:
        raise UsageError(f"{path}: `topic` {asked}: no such topic, found {_listed(topics)}{damage}")
    if asked is not None and not mappable:
        raise UsageError(f"{path}: `topic` {asked}: {named[0].why_not}")
    if not mappable:
        unread = [topic for topic in topics if topic.type in CLOUD_TYPES]
        if unread:
            reasons = "; ".join(f"{topic.name}: {topic.why_not}" for topic in unread[:3])
            more = f"; and {len(unread) - 3:,} more" if len(unread) > 3 else ""
            raise InputError(f"{path}: holds no clouds that can be read: {reasons}{more}{damage}")
        raise InputError(
            f"{path}: holds no clouds, found {_listed(topics)}; can be mapped: {MAPPABLE}{damage}"
        )
    if len({topic.name.strip("/") for topic in mappable}) > 1:
        raise UsageError(
            f"{path}: holds {len(mappable)} topics with clouds, of which `topic` picks one: "
            f"{_listed(mappable)}"
        )
    return max(mappable, key=lambda topic: topic.count or 0)


def beside(path: Path, chosen: Topic, topics: Sequence[Topic]) -> list[str]:
    """Return a note on messages of other types in the chosen topic that could be mapped, too."""
    others = [
        topic
        for topic in topics
        if topic is not chosen
        and topic.mappable
        and same(topic.name, chosen.name)
        and topic.count != 0
    ]
    if not others:
        return []
    types = ", ".join(f"{other.type}{_times(other.count)}" for other in others)
    return [f"{path}: {chosen.name} holds messages of other types, not taken: {types}"]


def same(name: str, other: str) -> bool:
    """Return whether two names are of one topic."""
    return name.strip("/") == other.strip("/")


def _listed(topics: Sequence[Topic]) -> str:
    return (
        ", ".join(f"{t.name} ({t.type or NO_TYPE}{_times(t.count)})" for t in topics) or "no topics"
    )


def _times(count: int | None) -> str:
    return "" if count is None else f" x {count}"
