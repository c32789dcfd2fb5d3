"""Channels and messages of several parts, brought together."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import TypeVar

from mlscli.io.containers.container import Channel, Message

Key = TypeVar("Key", bound=Hashable)
Part = TypeVar("Part")


def united(channels: Mapping[Key, Channel], counts: Mapping[Key, int | None]) -> dict[Key, Channel]:
    """Make one channel of those that differ in nothing but their counts.

    A topic has a connection for each of its publishers, and a channel in each of the files of a
    split recording.

    Parameters
    ----------
    channels : mapping
    counts : mapping
        The messages of each channel; 0 where it is missing here.

    Returns
    -------
    dict
        For each key the channel it belongs to, with the sum of the counts: None where one of
        them is.
    """
    alike: dict[Channel, list[int | None]] = {}
    for key, channel in channels.items():
        alike.setdefault(replace(channel, count=None), []).append(counts.get(key, 0))
    sums = {
        channel: replace(channel, count=None if None in parts else sum(filter(None, parts)))
        for channel, parts in alike.items()
    }
    return {key: sums[replace(channel, count=None)] for key, channel in channels.items()}


def in_settled_order(channels: Iterable[Channel]) -> list[Channel]:
    """Return each channel once, by topic, type and definition."""
    return sorted(set(channels), key=lambda c: (c.topic, c.type, c.encoding, c.schema))


def in_time_order(
    parts: Iterable[Part], start: Callable[[Part], float], read: Callable[[Part], Iterator[Message]]
) -> Iterator[Message]:
    """Merge parts into one stream by log time; only parts that overlap in time are held together.

    Parameters
    ----------
    parts : iterable
        In the order of the file, which decides between messages of equal times.
    start : callable
        Returns a time that is not after the first message of a part.
    read : callable
        Reads the messages of a part, in time order; called when the first of them is due.
    """
    running: list[tuple[int, int, Message, Iterator[Message]]] = []
    for _, place, part in sorted(
        ((start(part), place, part) for place, part in enumerate(parts)), key=lambda p: p[:2]
    ):
        yield from _until(start(part), running)
        messages = read(part)
        first = next(messages, None)
        if first is not None:
            heapq.heappush(running, (first.log_time, place, first, messages))
    yield from _until(math.inf, running)


def _until(
    time: float, running: list[tuple[int, int, Message, Iterator[Message]]]
) -> Iterator[Message]:
    """Take the messages before this time from the heap of running streams."""
    while running and running[0][0] < time:
        _, place, message, messages = running[0]
        yield message
        following = next(messages, None)
        if following is None:
            heapq.heappop(running)
        else:
            heapq.heapreplace(running, (following.log_time, place, following, messages))
