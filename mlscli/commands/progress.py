"""The progress of a run, shown on a terminal only."""

from __future__ import annotations

import os
import shutil
import sys
import time

import click

from mlscli.commands.verbosity import verbosity
from mlscli.runtime.notices import detail

BAR_WIDTH = 24
BETWEEN = 0.1  # seconds between two drawings


class ProgressBar:
    """A line on standard error with a bar, the rate and the time left.

    It is called with what is being done, how much of it is done, and how much there is; where the
    last is None, the bar is left out.
    """

    def __init__(self) -> None:
        seen = sys.stderr.isatty() and os.environ.get("TERM") != "dumb"
        self._shown = seen and verbosity() == "usual"
        self._what = ""
        self._begin = self._drawn = 0.0

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(self, *_: object) -> None:
        self._draw("")

    def __call__(self, what: str, done: int, total: int | None) -> None:
        """Draw the line, unless it was drawn a moment ago."""
        now = time.monotonic()
        if what != self._what:
            self._what, self._begin, self._drawn = what, now, 0.0
            detail(what)
        if now - self._drawn >= BETWEEN:
            self._drawn = now
            self._draw(line(what, done, total, now - self._begin))

    def _draw(self, text: str) -> None:
        if self._shown:
            # Clear the rest of a longer line drawn before; never wrap the line.
            width = shutil.get_terminal_size().columns - 1
            click.echo(f"\r{text[:width]}\x1b[K", nl=False, err=True)


def line(what: str, done: int, total: int | None, seconds: float) -> str:
    """Return the line for `what`, of which `done` of `total` are done after some seconds."""
    rate = done / seconds if seconds > 0 else 0.0
    speed = f"  {rate:,.0f}/s" if rate else ""
    if not total:
        return f"{what}  {done:,}{speed}"
    filled = min(BAR_WIDTH, BAR_WIDTH * done // total)
    bar = "#" * filled + "-" * (BAR_WIDTH - filled)
    left = f"  {_clock((total - done) / rate)} left" if rate and done < total else ""
    return f"{what:<10} [{bar}] {done:,}/{total:,}{speed}{left}"


def _clock(seconds: float) -> str:
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{seconds:02}" if hours else f"{minutes}:{seconds:02}"
