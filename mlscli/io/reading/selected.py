"""The clouds of a selection, as recorded: all of them, or those of the last message."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import count, islice

from mlscli.io.plausibility.epochs import Elapsed
from mlscli.io.reading.history import Moment
from mlscli.io.reading.selection import Selection
from mlscli.io.reading.tally import Tally
from mlscli.io.source import Cloud, Source, Wanted

# So many keyframes are enough to compare their clock with that of transforms.
_TIMES = 10_000


def selected(
    sources: Sequence[Source], selection: Selection, tally: Tally
) -> Iterator[tuple[Source, Cloud]]:
    """Read the clouds of a selection, each with its source; `tally` counts what comes."""
    wanted = _wanted(selection, tally)
    clouds = ((source, cloud) for source in sources for cloud in source.clouds(wanted))
    return islice(clouds, 0, None, selection.every)


def last_message(
    sources: Sequence[Source], selection: Selection, tally: Tally
) -> tuple[list[tuple[Source, Cloud]], list[Moment]]:
    """Read the clouds of the last message of a selection, of which `every` counts messages.

    Returns
    -------
    clouds : list of (Source, Cloud)
        With their source; none where no message is selected.
    times : list of Moment
        When all messages selected were taken.
    """
    by_time, numbers, times = _wanted(selection, tally), count(), list[Moment]()

    def wanted(stamp: float, logged: float = math.nan) -> bool:
        if not by_time(stamp, logged) or next(numbers) % selection.every:
            return False
        times.append(Moment(stamp, logged, source))
        return True

    last: list[tuple[Source, Cloud]] = []
    for source in sources:
        last = [(source, cloud) for cloud in source.latest(wanted)] or last
    return last, times


def _wanted(selection: Selection, tally: Tally) -> Wanted:
    """Return what chooses keyframes by time, and counts those that come."""
    elapsed = Elapsed()
    tally.jumps = elapsed.jumps
    choose = selection.chooser(elapsed)

    def wanted(stamp: float, logged: float = math.nan) -> bool:
        if not tally.came:
            tally.began = stamp
        tally.came += 1
        tally.stampless += stamp == 0
        tally.latest.append((stamp, logged))
        if len(tally.times) < _TIMES:
            tally.times.append((stamp, logged))
        return choose(stamp, logged)

    return wanted
