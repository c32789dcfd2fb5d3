"""Rows of figures, and how they are measured: in turns, as medians."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from statistics import median
from typing import NamedTuple

Work = Callable[[], object]


class Row(NamedTuple):
    """What was measured, what a user would pick instead, and the levels to reach.

    Attributes
    ----------
    what : str
        What was measured, in words.
    found : float
        The figure.
    unit : str
        Unit of the figure. More is better where it ends in ``/s``, a rate; otherwise less is.
    instead : str
        What was measured beside it, the other; or why it was not.
    other : float or None
        The other's figure, in the same unit.
    times : float or None
        The least ratio to the other, as in `ratio`.
    least, most : float or None
        The least and the greatest figure.
    short : bool
        Whether the row belongs to the short form, which the README shows.
    """

    what: str
    found: float
    unit: str
    instead: str = ""
    other: float | None = None
    times: float | None = None
    least: float | None = None
    most: float | None = None
    short: bool = False

    @property
    def ratio(self) -> float | None:
        """How many times as fast as the other it is; None without another."""
        if self.other is None:
            return None
        return self.found / self.other if self.unit.endswith("/s") else self.other / self.found

    @property
    def level(self) -> str:
        """The levels to reach, in words."""
        levels = [] if self.times is None else [f"{self.times:g} times"]
        levels += [] if self.least is None else [f"at least {self.least:g}"]
        levels += [] if self.most is None else [f"at most {self.most:g}"]
        return ", ".join(levels)

    @property
    def verdict(self) -> str:
        """Whether all levels are reached; empty without any."""
        missed = (
            (self.times is not None and (self.ratio or 0.0) < self.times)
            or (self.least is not None and self.found < self.least)
            or (self.most is not None and self.found > self.most)
        )
        return "" if not self.level else "MISSED" if missed else "reached"

    def cells(self) -> tuple[str, ...]:
        """Return the cells of the row in a topic's table."""
        return (
            self.what,
            f"{figure(self.found)} {self.unit}".rstrip(),
            self.instead,
            "" if self.other is None else figure(self.other),
            "" if self.ratio is None else figure(self.ratio),
            self.level,
            self.verdict,
        )

    def short_cells(self, command: str) -> tuple[str, ...]:
        """Return the cells of the row in the short form."""
        found = f"{figure(self.found)} {self.unit}".rstrip()
        if self.ratio is not None:
            found += f", {figure(self.ratio)} times {self.instead}"
        return (self.what, found, self.level, self.verdict, f"`{command}`")


HEAD = ("what", "figure", "instead", "its figure", "times", "level", "")
SHORT_HEAD = ("what", "figure", "level", "", "command")
WORDS = ("what", "instead", "", "command")


def figure(value: float) -> str:
    """Return a number with three significant digits, or without decimals from 100 on."""
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"


def lines(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> Iterator[str]:
    """Yield the lines of a table in Markdown, as its rows come."""
    yield f"| {' | '.join(head)} |"
    yield f"|{'|'.join(':--' if name in WORDS else '--:' for name in head)}|"
    for row in rows:
        yield f"| {' | '.join(row)} |"


class Timer(NamedTuple):
    """How to measure.

    Attributes
    ----------
    repeats : int
        How many times each work is measured; the median counts.
    cpu : bool
        Whether to measure CPU time of all threads, for a machine that others use; otherwise wall
        time.
    slow : bool
        Whether to measure as much as the levels speak of, where that takes minutes.
    """

    repeats: int = 3
    cpu: bool = False
    slow: bool = False

    def seconds(self, *works: Work) -> list[float]:
        """Return how long (s) each work takes; they take turns, the first not measured."""
        clock = time.process_time if self.cpu else time.perf_counter
        taken: list[list[float]] = [[] for _ in works]
        for turn in range(self.repeats + 1):
            for work, times in zip(works, taken, strict=True):
                begin = clock()
                work()
                if turn:
                    times.append(clock() - begin)
        return [median(times) for times in taken]

    def rates(self, size: int, *works: Work) -> list[float]:
        """Return the rate of each work, in millions a second, where it does `size` things."""
        return [size / seconds / 1e6 for seconds in self.seconds(*works)]
