"""Options of flights: how a synthetic one errs, what a camera sees, how large a craft is."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import click

from mlscli.commands.reading import Numbers

Command = TypeVar("Command", bound=Callable[..., Any])

craft_size = click.option(
    "--craft",
    type=Numbers("W,H"),
    required=True,
    help="The craft's width (its longest diagonal, seen from above) and height.",
)

features = click.option(
    "--features",
    type=int,
    metavar="N",
    help="With --cloud: points that a keyframe finds at most, more of them where the surface "
    "varies.  [default: 1000]",
)


def noisy(command: Command) -> Command:
    """Add ``--sigma`` and ``--noise``; the command takes them as `sigma` and `noise`."""
    sigma = click.option(
        "--sigma",
        type=Numbers("H,V"),
        default="0.05,0.05",
        show_default=True,
        help="Standard deviations of the points, horizontal and vertical.",
    )
    noise = click.option(
        "--noise",
        type=click.Choice(("thesis", "slam")),
        default="thesis",
        show_default=True,
        help="Salt and pepper in z, or depth errors that grow with the square of the distance.",
    )
    return sigma(noise(command))


def seeing(command: Command) -> Command:
    """Add ``--field-of-view`` and ``--range``; the command takes `field_of_view` and `reach`."""
    angle = click.option(
        "--field-of-view",
        type=float,
        default=120.0,
        show_default=True,
        metavar="DEG",
        help="Whole angle that the camera sees.",
    )
    reach = click.option(
        "--range",
        "reach",
        type=float,
        metavar="R",
        help="How far the camera sees; by default twice as far as from the highest place of the "
        "flight to the bottom.",
    )
    return angle(reach(command))
