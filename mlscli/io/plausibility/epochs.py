"""Clocks that begin anew: the stamps of messages, held against the order of their recording.

A simulation is reset, a recording is played in a loop, a computer's clock is set: then the stamps
go back, and one of them can mean several times. What was recorded while the stamps ran on is an
epoch. Two publishers whose clocks differ, or a single message with a wrong stamp, are none: stamps
that came before return soon.

References
----------
tf2 clears its buffer where time jumps back; here both sides of the jump are kept apart.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from mlscli.runtime.arrays import Float64

_BACK = 1.0
"""Stamps that go back by less (s) are out of order, as those of several publishers are."""

_DELAY = 1.0
"""Messages come in the wrong epoch by so much (s) at most, as some are recorded later."""

_SOON = 64

# A clock that goes ahead by more (s), and by so many times what the clock of the recording does.
_AHEAD, _TIMES = 60.0, 10.0


class Begin(NamedTuple):
    """Where an epoch begins after another.

    Attributes
    ----------
    logged : float
        When its first message was recorded, in seconds.
    before, after : float
        What the clock said last before, and first after it, in seconds.
    """

    logged: float
    before: float
    after: float


@dataclass(eq=False)
class Epochs:
    """The epochs of messages, in the order of their recording.

    Attributes
    ----------
    begins : list of Begin
        Where each but the first begins, ascending.
    runs : dict of key to list of tuple of int
        For each stream its runs: the number of the first message of each, that after its last one,
        and the first and the last epoch that it belongs to.
    """

    begins: list[Begin] = field(default_factory=list)
    runs: dict[Hashable, list[tuple[int, int, int, int]]] = field(default_factory=dict)

    @classmethod
    def of(cls, streams: Mapping[Hashable, tuple[Float64, Float64]]) -> Epochs:
        """Find the epochs of streams of messages.

        Parameters
        ----------
        streams : mapping of key to (float64 (N,), float64 (N,))
            When the messages of each were recorded, ascending, and their stamps; in seconds.
        """
        found = []
        for key, (logged, stamps) in streams.items():
            for row, before in _restarts(logged, stamps):
                begin = Begin(float(logged[row]), before, float(stamps[row]))
                found.append((begin, float(logged[row - 1]), key, row))
        found.sort(key=lambda each: each[0].logged)
        epochs = cls()
        there: set[Hashable] = set()
        restarts: dict[Hashable, list[tuple[int, int]]] = {}
        tellers: list[tuple[Hashable, int]] = []
        for begin, last, key, row in found:
            # One that is reset tells all streams of it, at the first message of each after it.
            if not epochs.begins or key in there or last > epochs.begins[-1].logged + _DELAY:
                epochs.begins.append(begin)
                tellers.append((key, row))
                there = set()
            there.add(key)
            restarts.setdefault(key, []).append((row, len(epochs.begins)))
        for key, (logged, stamps) in streams.items():
            if not len(logged):
                continue
            there = {epoch for _, epoch in restarts.get(key, [])}
            for epoch, (begin, (teller, row)) in enumerate(
                zip(epochs.begins, tellers, strict=True), start=1
            ):
                # What was silent for a while need not have gone back to be anew.
                after = int(np.searchsorted(logged, begin.logged))
                if epoch not in there and 0 < after < len(logged):
                    times, clock = (column[row:] for column in streams[teller])
                    now = float(np.interp(logged[after], times, clock))
                    if stamps[after] <= now + (begin.before - begin.after) / 2:
                        restarts.setdefault(key, []).append((after, epoch))
            restarts.get(key, []).sort()
            first = epochs.at(stamps[0], logged[0])
            end = max(epochs.at(stamps[-1], logged[-1]), first)
            rows = [(0, first), *restarts.get(key, [])]
            ends = [(row, epoch - 1) for row, epoch in rows[1:]] + [(len(logged), end)]
            epochs.runs[key] = [
                (row, stop, begin, max(last, begin))
                for (row, begin), (stop, last) in zip(rows, ends, strict=True)
            ]
        return epochs

    def at(self, stamp: float, logged: float) -> int:
        """Return the epoch of a message, by its stamp and the time of its recording (s)."""
        epoch = 0
        for begin in self.begins:
            since = logged - begin.logged
            is_past = since >= 0
            if abs(since) <= _DELAY:
                # It may have been under way: which clock is nearer?
                is_past = stamp - since <= (begin.before + begin.after) / 2
            epoch += is_past
        return epoch


def _restarts(logged: Float64, stamps: Float64) -> list[tuple[int, float]]:
    """Return the rows at which the clock of a stream begins anew, and what it said before."""
    if len(stamps) < 2 or not (np.diff(stamps) < -_BACK).any():
        return []
    # A single stamp ahead of both its neighbours, which are in order, is no time at all.
    ahead = np.zeros(len(stamps), dtype=np.bool_)
    before, here, after = stamps[:-2], stamps[1:-1], stamps[2:]
    ahead[1:-1] = (before <= after) & (here > after + _BACK)
    rows = []
    latest, begin = -math.inf, 0
    for row in np.flatnonzero(~ahead).tolist():
        stamp = stamps[row]
        if row > begin and stamp < latest - _BACK:
            # Were it anew, the clock would take as long as it went back to come here again.
            until = logged[row] + (latest - stamp) / 2
            stop = int(np.searchsorted(logged, until, side="right"))
            if not _returns(stamps[row:stop][~ahead[row:stop]], latest - _BACK / 2):
                rows.append((row, float(latest)))
                latest, begin = stamp, row
                continue
        latest = max(latest, stamp)
    return rows


def _returns(stamps: Float64, latest: float) -> bool:
    # Where it does, it does soon: the rest need not be looked at.
    return any((some >= latest).any() for some in (stamps[:_SOON], stamps[_SOON:]))


@dataclass
class Elapsed:
    """Seconds since the first keyframe, which run on where the clock jumps.

    Attributes
    ----------
    zero : float
        The stamp (s) that the clock in force would have had at the beginning; NaN before that.
    jumps : list of (float, float)
        What the clock said before each jump, and after it.
    """

    zero: float = math.nan
    jumps: list[tuple[float, float]] = field(default_factory=list)
    _last: tuple[float, float] = (math.nan, math.nan)
    _flown: tuple[float, float] = (0.0, 0.0)

    def come(self, stamp: float, logged: float) -> None:
        """Take the stamp of the next keyframe and when it was recorded, in seconds."""
        if math.isnan(stamp):
            return
        if math.isnan(self.zero):
            self.zero = stamp
        else:
            step, pause = stamp - self._last[0], logged - self._last[1]
            if self._jumps(step, pause):
                self.jumps.append((self._last[0], stamp))
                self.zero = stamp - (self._last[0] - self.zero + max(pause, 0.0))
            elif pause > 0:
                self._flown = self._flown[0] + max(step, 0.0), self._flown[1] + pause
        self._last = stamp, logged

    def _jumps(self, step: float, pause: float) -> bool:
        """Return whether a step of the stamps is none of the time that passed, a pause."""
        if step < -_BACK:
            return pause > step / 2
        if not step > _AHEAD + _TIMES * max(pause, 0.0):
            return False
        # Where the clock of the recording hardly runs at all, it tells nothing.
        stamps, recorded = self._flown
        return pause >= 0 and _TIMES * recorded >= stamps


def told(jumps: Sequence[tuple[float, float]]) -> str:
    """Return jumps of a clock as words."""
    before, after = jumps[0]
    more = f" and {len(jumps) - 1:,} more" if len(jumps) > 1 else ""
    return f"from {before:.3f} to {after:.3f} s{more}"
