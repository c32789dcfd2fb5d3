"""Options that say how a recording is read, for every command that reads one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, TypeVar

import click

from mlscli.commands.options import say, warn
from mlscli.commands.piped import piped

if TYPE_CHECKING:
    from mlscli.io.reading.recording import Recording
    from mlscli.runtime.arrays import Float64

Command = TypeVar("Command", bound=Callable[..., Any])


class Numbers(click.ParamType):  # type: ignore[type-arg, unused-ignore]  # generic since click 8.3
    """Numbers separated by commas.

    Parameters
    ----------
    names : str
        What they are, separated by commas: a value must have as many numbers as there are names.
    """

    name = "numbers"

    def __init__(self, names: str) -> None:
        self._names = names

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str:  # noqa: ARG002
        """Return what the help calls the value."""
        return self._names

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """Return the numbers; fail where the value is not as many numbers as expected."""
        if isinstance(value, tuple):
            return value
        texts = str(value).split(",")
        try:
            numbers = tuple(map(float, texts))
        except ValueError:
            numbers = ()
        if len(numbers) != self._names.count(",") + 1:
            self.fail(f"{value!r} is not {self._names}, all numbers", param, ctx)
        return numbers


class FormatsInHelp(click.Command):
    """A command that reads recordings: FORMATS in its help stands for those that can be read."""

    def format_help_text(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the help, the list of formats loaded for it alone."""
        from mlscli.io.reading.formats import readable

        self.help = (self.help or "").replace("FORMATS", readable())
        super().format_help_text(ctx, formatter)


def reading(command: Command) -> Command:
    """Add the options of `mlscli.open_recording`; a command takes them as keywords of its names."""
    options = (
        click.option(
            "--topic", metavar="NAME", help="Topic of the clouds, where a bag has several."
        ),
        click.option(
            "--columns",
            metavar="LIST",
            help="Columns of a text cloud, such as x,y,z,-,keyframe,cx,cy,cz: - skips one, "
            "cx,cy,cz is where the craft was, qx,qy,qz,qw its attitude, t a time stamp.",
        ),
        click.option(
            "--start",
            type=float,
            metavar="S",
            help="Leave out keyframes before this time: seconds from the beginning, or absolute.",
        ),
        click.option("--end", type=float, metavar="S", help="Leave out keyframes after this time."),
        click.option(
            "--every", type=int, default=1, metavar="N", help="Take every Nth keyframe only."
        ),
        click.option(
            "--crop",
            type=Numbers("xmin,xmax,ymin,ymax,zmin,zmax"),
            help="Leave out points outside these bounds of the map frame.",
        ),
        click.option(
            "--up",
            default="z",
            metavar="AXIS",
            help="Axis of the recording that points up: z (default), -z, y, -y, x or -x; auto "
            "finds it. Maps in a camera's frame mostly have y down: -y.",
        ),
        click.option(
            "--cumulative",
            is_flag=True,
            help="Each message repeats the whole cloud so far: take only points not seen before.",
        ),
        click.option(
            "--latest",
            is_flag=True,
            help="Each message repeats the whole map, corrected: take the last message alone.",
        ),
        click.option(
            "--frame",
            metavar="FRAME",
            help="The map frame. Clouds in it are taken as they are, also where it has no usual "
            "name (map, odom, world); others are moved into it by the transforms (/tf).",
        ),
        click.option(
            "--pose-topic",
            metavar="NAME",
            help="Topic that tells where the craft was (odometry, poses, a path), to move clouds "
            "by instead of the transforms.",
        ),
        click.option(
            "--extrinsic",
            type=Numbers("x,y,z,qx,qy,qz,qw"),
            help="Where the sensor is on the craft, where the recording does not tell.",
        ),
        click.option(
            "--time-source",
            type=click.Choice(["header", "log"]),
            default="header",
            help="Whose times count: those in the messages (default), or of their recording, for "
            "messages whose headers are empty.",
        ),
        click.option(
            "--pose-gap",
            type=float,
            metavar="SECONDS",
            help="Longest time between two transforms or poses across which is interpolated; by "
            "default 10 s, or three times their median spacing where that is more.",
        ),
        click.option(
            "--route",
            metavar="FILE",
            callback=piped,
            help="Trajectory of the craft, lines of: stamp x y z qx qy qz qw (TUM).",
        ),
        click.option(
            "--transform",
            metavar="FILE",
            callback=piped,
            help="Bring points and positions, once z points up, onto a map of another frame: the "
            "JSON file that mls align wrote.",
        ),
    )
    for option in reversed(options):
        command = option(command)
    return command


def georeferenced(command: Command) -> Command:
    """Add the options of `mlscli.open_recording` that say where on Earth a recording lies."""
    options = (
        click.option(
            "--crs",
            metavar="CRS",
            help="The reference system on Earth that the recording's coordinates are in, as "
            "EPSG:32632, or its text (WKT); by default as LAS, OpenSfM or an aligned COLMAP model "
            "say themselves.",
        ),
        click.option(
            "--crs-offset",
            type=Numbers("X,Y,Z"),
            help="What must be added to the recording's coordinates to come into --crs.",
        ),
    )
    for option in reversed(options):
        command = option(command)
    return command


def files_named(selection: Mapping[str, Any]) -> list[str]:
    """Return the files that options of `reading` name, which are never replaced."""
    return [selection[name] for name in ("route", "transform") if selection[name] is not None]


def read_points(recording: Recording) -> Float64:
    """Return all points of a recording, (N, 3), and say what is to know of how it was read."""
    import numpy as np

    clouds = [keyframe.points for keyframe in recording.keyframes()]
    for note in recording.notes:
        say(f"mls: {note}")
    for loss in recording.losses:
        warn(f"mls: warning: {loss}")
    return np.concatenate(clouds)
