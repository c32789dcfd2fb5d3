"""``mls align``: how a map lies in the frame of another of the same place."""

from __future__ import annotations

import json
import math
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mlscli.commands import report
from mlscli.commands.options import as_json, overwrite, tell
from mlscli.errors import InputError, UsageError

if TYPE_CHECKING:
    from mlscli.aligning.fit import Alignment
    from mlscli.maps.surface_map import SurfaceMap

_ENDINGS = (".json", ".npz")


@click.command()
@click.argument("one", metavar="A")
@click.argument("other", metavar="B")
@click.option(
    "-o",
    "--output",
    "outputs",
    metavar="FILE",
    multiple=True,
    help="The transform (.json; - prints it), with which mls build brings the recording of B onto "
    "A, or B moved patch by patch onto the grid of A (.npz). Can be given twice.",
)
@click.option(
    "--scale",
    type=float,
    metavar="S",
    help="What a length of B is in the unit of A, where that is known; otherwise it is searched.",
)
@click.option("--no-scale", is_flag=True, help="Both are in one unit, as --scale 1.")
@overwrite
@as_json
def command(
    one: str,
    other: str,
    outputs: tuple[str, ...],
    scale: float | None,
    no_scale: bool,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Find yaw, shift and scale that bring map B onto map A of the same place.

    Both must have z up. No first guess is needed. Where nothing fits well, or more than one fit is
    about as good, as in a place that looks alike from both sides, this is said, nothing is written,
    and the exit status is 1.
    """
    if no_scale:
        if scale is not None:
            raise UsageError("--no-scale: does not go with --scale; leave one of them out")
        scale = 1.0

    from mlscli.io.writing.atomic import atomic_write, refuse_existing

    if "-" in outputs:
        as_json, outputs = True, tuple(output for output in outputs if output != "-")
    endings = [Path(output).suffix.lower() for output in outputs]
    for output, ending in zip(outputs, endings, strict=True):
        if ending not in _ENDINGS or endings.count(ending) > 1:
            raise UsageError(f"-o {output}: one .json for the transform, one .npz for the map")
        refuse_existing(output, overwrite=overwrite, sources=[one, other])

    from mlscli.aligning.fit import align_maps
    from mlscli.aligning.moving import moved_map
    from mlscli.io.reading.transform import onto
    from mlscli.io.writing.npz import read_map, write_map
    from mlscli.maps.georeference import GEOREFERENCE
    from mlscli.maps.recorded import TURN

    first, second = read_map(one), read_map(other)
    try:
        found = align_maps(first, second, scale)
        transform = onto(found.fit, first.meta, first.frame_id, second.meta).to_dict()
        told = {"a": one, "b": other, **found.to_dict(), **transform}
        for output, ending in zip(outputs, endings, strict=True):
            if ending == ".json":
                with atomic_write(output, overwrite=overwrite) as stream:
                    stream.write((json.dumps(told, indent=2) + "\n").encode())
            else:
                moved = moved_map(second, found.fit, first.grid)
                reading = second.meta.get("reading", {}) | {"transform": transform}
                moved.meta.pop(GEOREFERENCE, None)
                held = {name: transform[name] for name in (TURN, GEOREFERENCE) if name in transform}
                moved.meta.update({"reading": reading} | held)
                write_map(output, moved, overwrite=overwrite)
    except (InputError, UsageError) as error:
        raise type(error)(f"{other} onto {one}: {error}") from None
    if as_json:
        click.echo(json.dumps(told, indent=2))
    else:
        tell(_text(one, other, found, first, second))


def _text(one: str, other: str, found: Alignment, first: SurfaceMap, second: SurfaceMap) -> str:
    fit = found.fit
    x, y, z = fit.shift
    cells = f"{found.rms / first.cell_size:.2g} of its cells"
    grid = " ".join(f"--set map.{name}={value!r}" for name, value in _lengths(first).items())
    sources = shlex.join(map(str, second.meta.get("sources", []))) or "SOURCE"
    rows = [
        ("yaw", f"{math.degrees(fit.yaw):.3f} degrees"),
        ("scale", f"{fit.scale:.6g}"),
        ("shift", f"x {x:.6g}, y {y:.6g}, z {z:.6g}"),
        (
            "agree",
            f"{found.agreement:.0%} of the surfaces where both have measured, which are "
            f"{found.overlap:.0%}",
        ),
        ("residual", f"floors are {found.rms:.3g} apart, rms, {cells}"),
        ("next best", f"{found.rival:.0%} of the evidence"),
        ("rebuild", f"mls build {sources} --transform FILE.json {grid}"),
    ]
    return f"{other} onto {one}\n{report.lines(rows)}"


def _lengths(surface: SurfaceMap) -> dict[str, float]:
    from mlscli.maps.grid import LENGTHS

    return {name: getattr(surface, name) for name in LENGTHS}
