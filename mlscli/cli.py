"""The command line: commands that are imported when they are called, errors, exit statuses.

This is the only place that exits. Errors are a line each on standard error. Exit statuses: 0 done,
1 the work failed, 2 wrong usage or configuration, 3 done, but part of the input could not be read,
4 the map cannot tell, 130 and 143 interrupted.
"""

from __future__ import annotations

import os
import signal
import sys
import traceback
import warnings
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from types import FrameType
from typing import NoReturn

import click

from mlscli.commands.completion import VARIABLE, completed
from mlscli.commands.verbosity import verbosity, with_verbosity, write_line
from mlscli.errors import ConfigError, MlsError, nearest, printable, shorten, with_options
from mlscli.runtime.interrupts import end_in_time, when_safe
from mlscli.runtime.notices import hear
from mlscli.runtime.temporary import remove_present
from mlscli.version import __version__

# Name to module and to a line of help, so that the help of the group imports no command.
COMMANDS = {
    "build": ("mlscli.commands.build", "Build a map from a recording."),
    "export": ("mlscli.commands.export", "Write a map as a mesh, or for a planner."),
    "view": ("mlscli.commands.view", "Look at a map in the browser."),
    "plot": ("mlscli.commands.plot", "Draw a map from above, cut upright, or beside another."),
    "info": ("mlscli.commands.info", "Say what a recording or a map holds."),
    "query": ("mlscli.commands.query", "Say what a map holds at places."),
    "merge": ("mlscli.commands.merge", "Merge maps of several flights."),
    "align": ("mlscli.commands.align", "Find how a map lies in the frame of another."),
    "clearance": ("mlscli.commands.clearance", "Say whether a craft fits along a way."),
    "explore": ("mlscli.commands.explore", "Say where to fly next, and what a look would settle."),
    "compare": ("mlscli.commands.compare", "Compare maps, or a map with the truth or a scan."),
    "synth": ("mlscli.commands.synth", "Make a synthetic flight, and its exact truth."),
    "bench": (
        "mlscli.commands.bench",
        "Measure what the stages are worth, or how fast batches are.",
    ),
    "warmup": ("mlscli.commands.warmup", "Compile what is compiled when it is first needed."),
    "config": ("mlscli.commands.config", "Write, show and check parameters."),
    "completion": ("mlscli.commands.completion", "Have a shell complete commands and their words."),
}


LONGEST_LINE = 2000
"""Of an error more is left out."""


class Stopped(BaseException):
    """A signal asks the program to stop; unwinding removes unfinished outputs."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.exit_status = 128 + number


class LazyGroup(click.Group):
    """A group whose commands are imported when they are called."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """Return the names of the commands."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """Import a command; None for an unknown name."""
        if cmd_name not in COMMANDS:
            return None
        command = with_verbosity(import_module(COMMANDS[cmd_name][0]).command)
        return completed(command) if VARIABLE in os.environ else command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command that the arguments begin with, or suggest the nearest."""
        name = args[0]
        if name not in COMMANDS and not name.startswith("-"):
            ctx.fail(f"no command {name!r}; {nearest(name, COMMANDS)}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """List the commands without importing any."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, help_line) for name, (_, help_line) in COMMANDS.items()])


@dataclass
class Run:
    """The state of one run of the program.

    Attributes
    ----------
    debug : bool
        Whether errors are printed with a traceback.
    stopped : Stopped or None
        The signal that has stopped the run.
    reported : bool
        Whether it is told how the run ended.
    """

    debug: bool = False
    stopped: Stopped | None = None
    reported: bool = False


@click.group(
    cls=LazyGroup, no_args_is_help=False, context_settings={"help_option_names": ["-h", "--help"]}
)
@click.version_option(__version__, prog_name="mls")
@click.option("--debug", is_flag=True, help="Show where in the program an error arose.")
@click.pass_obj
def commands(run: Run, debug: bool) -> None:
    """Multi-level surface maps and meshes from recorded drone flights."""
    run.debug = debug


with_verbosity(commands)


def main() -> NoReturn:
    """Run the command line and exit."""
    run = Run()
    _open_streams()
    for number in (signal.SIGINT, signal.SIGTERM):
        # A signal that is ignored, as under nohup, stays ignored.
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, partial(_stop, run))
    end_in_time(partial(_end, run))
    hear(_say)
    # Where numbers overflow, a result is refused or told; the user can do nothing about the rest.
    warnings.simplefilter("ignore", RuntimeWarning)
    try:
        status = _status(run)
    except BaseException as error:
        # `Stopped` may have become another exception on its way here.
        status = _report(run.stopped or error, run)
    run.reported = True
    sys.exit(status)


def _open_streams() -> None:
    """Open nothing in place of standard streams that are closed.

    Outputs would get their numbers, and Python has None for them.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            handle = os.open(os.devnull, os.O_RDWR)
            setattr(sys, name, os.fdopen(handle, "r+" if number else "r", closefd=False))


def _end(run: Run, number: int) -> None:
    """End at once, as the main thread has not come to it in time: it is in a kernel, or waits."""
    remove_present()
    if not run.reported:
        with suppress(OSError):
            os.write(2, b"mls: interrupted\n")
    os._exit(128 + number)


def _stop(run: Run, number: int, frame: FrameType | None) -> None:  # noqa: ARG001
    # A second signal must not interrupt the cleanup.
    for each in (signal.SIGINT, signal.SIGTERM):
        signal.signal(each, signal.SIG_IGN)
    stopped = run.stopped = Stopped(number)

    def stop() -> NoReturn:
        raise stopped

    when_safe(stop)


def _status(run: Run) -> int:
    status = commands.main(prog_name="mls", standalone_mode=False, obj=run)
    # A full disk shows only now, and must not pass for success.
    sys.stdout.flush()
    return status if isinstance(status, int) else 0


def _say(notice: str) -> None:
    if verbosity() != "quiet":
        write_line(f"mls: {printable(notice)}")


def _report(error: BaseException, run: Run) -> int:
    """Print what went wrong and return the exit status."""
    if isinstance(error, SystemExit | OSError):
        # What is left for standard output is discarded, so that flushing it at exit cannot fail.
        with suppress(OSError, ValueError, AttributeError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    if isinstance(error, SystemExit):
        return error.code if isinstance(error.code, int) else 1
    if isinstance(error, BrokenPipeError):
        # The reader has stopped, as `head` does.
        return 1
    lines, status = _explain(error)
    with suppress(OSError):
        if run.debug:
            traceback.print_exception(error)
        for line in lines:
            click.echo(f"mls{shorten(printable(line), LONGEST_LINE)}", err=True)
    return status


def _explain(error: BaseException) -> tuple[list[str], int]:
    """Return the lines to print after the program's name, and the exit status."""
    match error:
        case ConfigError():
            return [f": {with_options(fault)}" for fault in error.faults], error.exit_status
        case MlsError():
            return [f": {with_options(str(error))}"], error.exit_status
        case click.UsageError():
            path = error.ctx.command_path if error.ctx else "mls"
            message = " ".join(error.format_message().split()).rstrip(".")
            return [f"{path.removeprefix('mls')}: {message} (see '{path} --help')"], 2
        case click.ClickException():
            return [f": {error.format_message()}"], error.exit_code
        case Stopped():
            return [": interrupted"], error.exit_status
        case click.Abort() | KeyboardInterrupt():
            return [": interrupted"], 128 + signal.SIGINT
        case OSError():
            name = error.filename or "standard output"
            return [f": {name}: {error.strerror or error}"], 1
        case MemoryError():
            return [": out of memory; crop the recording or choose a larger cell size"], 1
        case _:
            what = f"{type(error).__name__}: {error}".rstrip(": ")
            advice = "run again as 'mls --debug ...' for the traceback"
            return [f": internal error: {what}; {advice}"], 1
