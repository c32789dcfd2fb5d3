"""A glance at sources ends where it is said to.

How one could cheat: a source that is read to its end and then cut; a bound that only the first
pass knows, or that each source has for itself; messages nobody wants, read without an end.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from itertools import count
from typing import Any, cast

import numpy as np
import pytest

from mlscli.io.reading.glance import Glance
from mlscli.io.source import Cloud, Source, Wanted


class Flight:
    """Messages of ten points, a second apart, counted as they are asked for."""

    def __init__(self, messages: int | None = None) -> None:
        self.label = "flight"
        self.asked = 0
        self._messages = messages

    def clouds(self, wanted: Wanted) -> Iterator[Cloud]:
        for number in count() if self._messages is None else range(self._messages):
            self.asked += 1
            if wanted(float(number)):
                yield Cloud(np.ones((10, 3)), float(number))

    def transforms(self) -> Iterator[Any]:
        for self.asked in count(1):
            yield ()


def source_of(glance: Glance, flight: Flight) -> Source:
    return glance.of(cast("Source", flight))


def test_so_many_points_are_read_in_each_pass_and_no_message_more() -> None:
    flight, glance = Flight(), Glance(points=45, seconds=60)
    source = source_of(glance, flight)
    for passes in (1, 2):
        assert [cloud.stamp for cloud in source.clouds()] == [0, 1, 2, 3, 4]
        assert glance.cut
        # The next message is met, and neither it nor any other is taken.
        assert flight.asked == 6 * passes


@pytest.mark.parametrize(("messages", "cut"), [(4, False), (5, False), (6, True)])
def test_it_is_known_whether_that_was_all(messages: int, cut: bool) -> None:
    glance = Glance(points=45, seconds=60)
    assert len(list(source_of(glance, Flight(messages)).clouds())) == min(messages, 5)
    assert glance.cut == cut


def test_sources_in_turn_share_the_bound() -> None:
    flights, glance = [Flight(3), Flight(3), Flight(3)], Glance(points=45, seconds=60)
    sources = [source_of(glance, flight) for flight in flights]
    for _ in range(2):
        assert [len(list(source.clouds())) for source in sources] == [3, 2, 0]
    assert glance.cut


def test_messages_that_nobody_wants_end_with_the_time() -> None:
    glance = Glance(seconds=0.05)
    assert not list(source_of(glance, Flight()).clouds(lambda _stamp, _logged=0.0: False))
    assert glance.cut


def test_transforms_end_with_the_time() -> None:
    flight, glance = Flight(), Glance(seconds=0.05)
    assert len(list(source_of(glance, flight).transforms())) == flight.asked
    assert glance.poses_cut
    assert not glance.cut


def test_all_else_is_the_source_itself() -> None:
    assert source_of(Glance(), Flight()).label == "flight"


def test_a_file_that_takes_long_to_open_is_looked_at_all_the_same() -> None:
    class Slow(Flight):
        def clouds(self, wanted: Wanted) -> Iterator[Cloud]:
            time.sleep(0.05)
            yield from super().clouds(wanted)

    glance = Glance(points=45, seconds=0.02)
    assert len(list(source_of(glance, Slow(3)).clouds())) == 3
