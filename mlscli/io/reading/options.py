"""Checks of the user's options for reading: of what type they are, and whether they apply."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from numbers import Real
from types import NoneType
from typing import get_args

from mlscli.errors import UsageError, expect, expect_items
from mlscli.geometry.transforms import bare
from mlscli.geometry.up import UP_AXES
from mlscli.io.source import Clock, Source

AUTO = "auto"
"""The value of `up` with which the vertical is searched for."""


def check_types(
    *,
    texts: Mapping[str, object],
    named: Mapping[str, object],
    times: Mapping[str, object],
    numbers: Mapping[str, Sequence[float] | None],
) -> None:
    """Check values by the names of their options.

    Parameters
    ----------
    texts, times, numbers : mapping
        Those that are a text, a number of seconds, or a sequence of numbers; or None.
    named : mapping
        Those that are one of several texts.

    Raises
    ------
    TypeError
        One is of another type.
    """
    for name, value in texts.items():
        expect(value, (str, NoneType), name, "a text")
    for name, value in named.items():
        expect(value, str, name, "a text")
    for name, value in times.items():
        expect(value, (Real, NoneType), name, "a number of seconds")
    for name, several in numbers.items():
        if several is not None:
            expect_items(several, name, "a sequence of numbers")


def check_values(up: str, frame: str | None, time_source: str, pose_gap: float | None) -> None:
    """Raise `UsageError` where an option is out of range, whatever the sources are."""
    if up not in (*UP_AXES, AUTO):
        raise UsageError(f"`up` {up}: expected one of {', '.join(UP_AXES)}, {AUTO}")
    if frame is not None and not bare(frame):
        raise UsageError("`frame`: expected the name of the map frame, found nothing")
    if time_source not in get_args(Clock):
        expected = ", ".join(get_args(Clock))
        raise UsageError(f"`time_source` {time_source}: expected one of {expected}")
    if pose_gap is not None and not pose_gap > 0:
        raise UsageError(f"`pose_gap` {pose_gap}: expected seconds, more than 0")


def check_latest(sources: Sequence[Source], *, cumulative: bool) -> None:
    """Raise `UsageError` where `latest` cannot be used."""
    if cumulative:
        raise UsageError("`latest`: does not go with `cumulative`; leave one of them out")
    for source in sources:
        if not source.topics():
            raise UsageError(
                f"`latest`: {source.path} ({source.kind}) holds no messages; leave it out"
            )


def check_applies(argument: str, value: object, applies: Sequence[bool], what: str) -> None:
    """Raise `UsageError` where an option is given that fits no source."""
    if value is not None and not any(applies):
        raise UsageError(f"`{argument}` {value}: no source is {what}")
