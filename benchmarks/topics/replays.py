"""The replay of a village, beside what its messages hold."""

from __future__ import annotations

from collections.abc import Iterator

from benchmarks.replays import MEGA, measured
from benchmarks.table import Row, Timer

HOUSES = 14


def rows(timer: Timer) -> Iterator[Row]:  # noqa: ARG001
    """Yield the size of the file, and how long a jump to another time takes."""
    found = measured(HOUSES)
    what = f"replay of {found.states:,} states of {found.patches:,} patches"
    yield Row(what, found.size / MEGA, "MB", "whole states", found.held / MEGA, most=40)
    yield Row(f"{what}: a jump", found.jump, "s")
