"""Merge the channels and the messages of several parts."""

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
    """Merge channels that differ in nothing but their counts.

    A topic has a connection for each of its publishers, and a channel in each of the files of a
    split recording.

    Parameters
    ----------
    channels : mapping of key to Channel
    counts : mapping of key to int or None
        Number of messages of each channel; 0 where a key is missing.

    Returns
    -------
    dict of key to Channel
        The merged channel of each key, with the sum of the counts; None where one of them is None.
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
    """Return each channel once, sorted by topic, type, encoding and schema."""
    return sorted(set(channels), key=lambda c: (c.topic, c.type, c.encoding, c.schema))


def in_time_order(
    parts: Iterable[Part], start: Callable[[Part], float], read: Callable[[Part], Iterator[Message]]
) -> Iterator[Message]:
    """Merge the messages of parts by log time; only parts that overlap in time are read together.

    Parameters
    ----------
    parts : iterable
        In the order of the file, which decides between messages of equal times.
    start : callable
        Returns a time in nanoseconds that is not after the first message of a part.
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
    """Yield the messages before this time (ns) from the heap of running streams."""
    while running and running[0][0] < time:
        _, place, message, messages = running[0]
        yield message
        following = next(messages, None)
        if following is None:
            heapq.heappop(running)
        else:
            heapq.heapreplace(running, (following.log_time, place, following, messages))
