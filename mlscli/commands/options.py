"""Options that several commands share, each worded once."""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import suppress
from typing import Any, TypeVar

import click
from click.core import ParameterSource

from mlscli.commands.piped import piped
from mlscli.commands.verbosity import verbosity
from mlscli.errors import UsageError, printable, with_options

Command = TypeVar("Command", bound=Callable[..., Any])

PARTLY_READ = 3
"""The exit status where the work is done, but part of the input could not be read."""


class Size(click.ParamType):  # type: ignore[type-arg, unused-ignore]  # generic since click 8.3
    """A number of bytes, with K, M, G or T for powers of 1024."""

    name = "size"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Return the number of bytes; fail where the value is no size."""
        if isinstance(value, int):
            return value
        found = re.fullmatch(r"(\d+(?:\.\d+)?)([KMGT]?)B?", str(value).strip().upper())
        if found is None:
            self.fail(f"{value!r} is no size; write 2G or 500M", param, ctx)
        return int(float(found[1]) * 1024 ** " KMGT".index(found[2] or " "))


class Span(click.ParamType):  # type: ignore[type-arg, unused-ignore]  # generic since click 8.3
    """A time in seconds, with s, m or h for seconds, minutes and hours."""

    name = "span"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the seconds; fail where the value is no time."""
        if isinstance(value, int | float):
            return value
        found = re.fullmatch(r"(\d+(?:\.\d+)?)([smh]?)", str(value).strip().lower())
        if found is None:
            self.fail(f"{value!r} is no time; write 30s, 10m or 2h", param, ctx)
        return float(found[1]) * {"": 1, "s": 1, "m": 60, "h": 3600}[found[2]]


setting = click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="NAME=VALUE",
    help="Set one parameter, such as plaster.max_gap=0.4 or mode=sequential.",
)


def configured(command: Command) -> Command:
    """Add ``-c`` and ``--set``; the command takes them as `config` and `settings`."""
    config = click.option(
        "-c",
        "--config",
        metavar="FILE",
        callback=piped,
        help="Parameters in YAML, or a preset: default, plain, thesis.",
    )
    return config(setting(command))


overwrite = click.option("--overwrite", is_flag=True, help="Replace the output where it exists.")

coloured = click.option(
    "--color",
    "colour",
    type=click.Choice(("height", "origin", "variance", "uncertainty", "count", "region", "time")),
    default="height",
    show_default=True,
    help="What colours stand for.",
)

without_artificial = click.option(
    "--no-artificial", is_flag=True, help="Leave out artificial (red) patches."
)

least_lines = click.option(
    "--least",
    type=click.IntRange(1, 255),
    default=2,
    show_default=True,
    metavar="N",
    help="Space is free where so many sight lines passed through it.",
)

as_json = click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")


def say(message: str) -> None:
    """Print a note on standard error, unless the user wants quiet; see `warn` for the rest.

    Arguments in backquotes become options, as `mlscli.errors.with_options` has it.
    """
    if verbosity() != "quiet":
        warn(message)


def warn(message: str) -> None:
    """Print a warning or an error on standard error, as `say` prints notes."""
    with suppress(OSError):
        # Where nobody can hear it, the work goes on.
        click.echo(printable(with_options(message)), err=True)


def tell(result: str) -> None:
    """Print a result on standard output, escaped line by line, see `printable`."""
    click.echo("\n".join(map(printable, result.split("\n"))))


def refuse_given(why: str, *names: str) -> None:
    """Refuse options that were given and do not go with others.

    Parameters
    ----------
    why : str
        What is wrong with giving them.
    names : str
        The names under which the command takes them.

    Raises
    ------
    UsageError
        Naming the first of them.
    """
    context = click.get_current_context()
    for option in context.command.params:
        source = context.get_parameter_source(option.name or "")
        if option.name in names and source is ParameterSource.COMMANDLINE:
            off = option.secondary_opts and context.params[option.name] is False
            raise UsageError(f"{(option.secondary_opts if off else option.opts)[0]}: {why}")
