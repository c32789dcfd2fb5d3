"""What SQLite files, ROS 1 bags and MCAP files share: one file of messages, and its losses."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from mlscli.errors import InputError
from mlscli.io.containers.container import Channel
from mlscli.io.containers.losses import Losses
from mlscli.io.containers.streams import in_settled_order, united
from mlscli.io.files import open_input


class MessageFile(ABC):
    """A container that is one file.

    Parameters
    ----------
    path : Path
    name : Path, optional
        Its name in messages to the user; its path where not given.

    Raises
    ------
    InputError
        The file cannot be read at all.
    """

    kind: str
    notes: Sequence[str] = ()

    def __init__(self, path: Path, name: Path | None = None) -> None:
        self.path = path
        self.name = name or path
        self._found = Losses(self.name)
        definitions, counts = self._contained()
        if unknown := sum(count for channel, count in counts.items() if channel not in definitions):
            self._found.add(
                f"{unknown:,} messages belong to no topic that it names", messages=unknown
            )
        self._channels = united(definitions, counts)
        self._last = self._found

    @abstractmethod
    def _contained(self) -> tuple[Mapping[int, Channel], Mapping[int, int]]:
        """Find the messages, and record losses.

        Returns
        -------
        definitions : mapping of int to Channel
            The channels defined, by number, without counts.
        counts : mapping of int to int
            Number of messages, by channel number.
        """

    @property
    def channels(self) -> Sequence[Channel]:
        """Its channels, sorted by topic, type, encoding and schema."""
        return in_settled_order(self._channels.values())

    @property
    def losses(self) -> Sequence[str]:
        """What opening it and the last pass could not read, in one line."""
        return self._last.lines()

    def _begin(self, topics: Collection[str] | None) -> tuple[dict[int, Channel], Losses]:
        """Begin a pass: return the channels of these topics, or all, and losses to add to."""
        self._last = self._found.copy()
        wanted = {
            number: channel
            for number, channel in self._channels.items()
            if topics is None or channel.topic in topics
        }
        return wanted, self._last

    @contextmanager
    def _opened(self) -> Iterator[BinaryIO]:
        try:
            with open_input(self.path) as file:
                yield file
        except OSError as error:
            raise InputError(f"{self.name}: cannot be read: {error.strerror or error}") from error


def declared(channels: Iterable[Channel]) -> Counter[str]:
    """Return how many messages channels declare, by topic; each channel counts once."""
    counts: Counter[str] = Counter()
    for channel in set(channels):
        counts[channel.topic] += channel.count or 0
    return counts
