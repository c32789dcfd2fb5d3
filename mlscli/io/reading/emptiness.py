"""Why a pass over a recording has yielded no points, in the words of the error."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from mlscli.io.reading.tally import Tally

TIMELESS = (
    "the time in the headers of all clouds is 0; `time_source` log takes the times of recording"
)


class Pass(NamedTuple):
    """A pass that has ended.

    Attributes
    ----------
    messages : int
        How many messages there were, where the last alone was taken; else 0.
    is_timeless : bool
        Whether the time in the headers of all clouds is 0.
    by_time : bool
        Whether keyframes were selected by time.
    by_header : bool
        Whether the times in the headers count.
    """

    messages: int
    is_timeless: bool
    by_time: bool
    by_header: bool


def why_empty(sources: Sequence[str], tally: Tally, lost: Sequence[str], ended: Pass) -> str:
    """Return why a pass has yielded no points, and what helps.

    Parameters
    ----------
    sources, lost : sequence of str
        The files and folders, and what could not be read of them.
    tally : Tally
        Of the pass.
    ended : Pass
    """
    named, losses = ", ".join(sources), "".join(f"; {loss}" for loss in lost)
    if ended.is_timeless and (tally.unplaced or not tally.keyframes):
        losses = f"; {TIMELESS}{losses}"
    elif tally.unplaced == tally.keyframes > 0:
        clock = "log" if ended.by_header else "header"
        losses = (
            f"; the clouds begin at {tally.began:.3f} s, where transforms and poses do not reach; "
            f"`time_source` {clock} takes other times; if these do not reach either, `frame` says "
            "which frame stands still"
            f"{losses}"
        )
    if ended.messages and not lost:
        losses = f"{losses}; it is the last message of {ended.messages:,}, `end` takes others"
    if not tally.keyframes:
        where = " between `start` and `end`" if ended.by_time else ""
        return f"{named}: holds no keyframes{where}{losses}"
    reasons = ", ".join(f"{count:,} {reason}" for reason, count in tally.dropped.items())
    dropped = f" to map: all {tally.points_read:,} were dropped, {reasons}" if reasons else ""
    return f"{named}: holds no points{dropped}{losses}"
