"""How much the program tells on standard error: the options ``-q`` and ``-v`` of every command."""

from __future__ import annotations

import sys
import time
from contextlib import suppress
from typing import Literal

import click

from mlscli.errors import UsageError, printable
from mlscli.runtime.notices import hear_details

Verbosity = Literal["quiet", "usual", "verbose"]

_BEGUN = time.monotonic()
_asked: set[Verbosity] = set()


def verbosity() -> Verbosity:
    """Return what was asked for: results, warnings and errors alone, the usual, or every step."""
    return next(iter(_asked), "usual")


def write_line(line: str) -> None:
    """Write a line on standard error; where nobody can hear it, the work goes on."""
    with suppress(OSError):
        # On a terminal, the line is cleared first: it may hold a progress bar.
        click.echo(f"\r\x1b[K{line}" if sys.stderr.isatty() else line, err=True)


def step(line: str) -> None:
    """Tell a step, with how long the program has run."""
    write_line(f"mls: {time.monotonic() - _BEGUN:.2f} s: {printable(line)}")


def with_verbosity(command: click.Command) -> click.Command:
    """Add ``-q`` and ``-v`` to a command, and to those below it."""
    if not any(option.name == "quiet" for option in command.params):
        command.params += _options()
    if isinstance(command, click.Group):
        for below in command.commands.values():
            with_verbosity(below)
    return command


def _options() -> list[click.Parameter]:
    return [
        click.Option(
            ["-q", "--quiet"],
            is_flag=True,
            expose_value=False,
            is_eager=True,
            callback=_ask,
            help="Tell results, warnings and errors only: no notes, no progress.",
        ),
        click.Option(
            ["-v", "--verbose"],
            is_flag=True,
            expose_value=False,
            is_eager=True,
            callback=_ask,
            help="Tell each step, and each file that is read or written, with the time.",
        ),
    ]


def _ask(context: click.Context, option: click.Parameter, given: bool) -> None:  # noqa: ARG001
    if not given or option.name in _asked:
        return
    _asked.add("quiet" if option.name == "quiet" else "verbose")
    if len(_asked) > 1:
        raise UsageError("--quiet: does not go with --verbose; leave one of them out")
    if verbosity() == "verbose":
        hear_details(step)
