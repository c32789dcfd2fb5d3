"""Maps for Nav2's map_server (and that of ROS 1): an image and a YAML file for each storey.

The image is a PGM, a pixel for each cell, its first row that of the greatest y. By the rule of
map_server's mode ``trinary``, p = (255 - pixel) / 255 is occupied above 0.65, free below 0.25 and
else unknown. Unknown is written as 128, not as the usual 205: p = 0.196 would be free by the
threshold of 0.25 that Nav2 has by default.
"""

from __future__ import annotations

import os
from numbers import Integral, Real
from pathlib import Path
from types import NoneType
from typing import NamedTuple

import numpy as np

from mlscli.errors import OutputError, UsageError, expect, expect_path
from mlscli.io.writing.atomic import refuse_existing, write_together
from mlscli.maps.space import FREE, OCCUPIED, UNKNOWN
from mlscli.maps.surface_map import SurfaceMap
from mlscli.rasters.extent import Extent
from mlscli.rasters.flying import at_height
from mlscli.rasters.robot import Robot
from mlscli.rasters.storeys import storeys_of
from mlscli.runtime.arrays import UInt8

PIXELS = {OCCUPIED: 0, FREE: 254, UNKNOWN: 128}
OCCUPIED_ABOVE, FREE_BELOW = 0.65, 0.25


class Sheet(NamedTuple):
    """One image and its YAML file.

    Attributes
    ----------
    file : Path
        The YAML file.
    what : str
        What it shows, in words.
    free, occupied, unknown : int
        How many cells are so.
    """

    file: Path
    what: str
    free: int
    occupied: int
    unknown: int


class Sheets(NamedTuple):
    """What was written.

    Attributes
    ----------
    sheets : list of Sheet
        From the lowest storey up.
    left_out : int
        Cells with a floor that is on no storey, as it is too small.
    """

    sheets: list[Sheet]
    left_out: int


def write_nav2(
    path: str | os.PathLike[str],
    surface: SurfaceMap,
    robot: Robot | None = None,
    *,
    flying_height: float | None = None,
    least: int = 2,
    overwrite: bool = False,
) -> Sheets:
    """Write what a robot finds on each storey, or a craft at a flying height, for map_server.

    Parameters
    ----------
    path
        The YAML file; its image lies beside it, ``.pgm``. Storeys are numbered from the lowest up:
        of ``house.yaml``, ``house.1.yaml`` and ``house.1.pgm``, and so on.
    surface : SurfaceMap
    robot : Robot, optional
        See `mlscli.rasters.robot.Robot`.
    flying_height : float, optional
        Write what a craft meets there instead, see `mlscli.rasters.flying.at_height`.
    least : int
        For that: how many sight lines make space free.
    overwrite : bool

    Returns
    -------
    Sheets

    Raises
    ------
    UsageError
        Where the map is empty, too wide for an image, or has no floor for the robot.
    OutputError
        Where the name does not end in .yaml; one of the files exists and `overwrite` is False, or
        cannot be written; or there is a file of a storey that the map does not have, of an earlier
        export.
    """
    expect_path(path, "path", "the file to write")
    expect(surface, SurfaceMap, "surface", "a map (SurfaceMap)")
    expect(robot, (Robot, NoneType), "robot", "a Robot")
    expect(flying_height, (Real, NoneType), "flying_height", "a number")
    expect(least, Integral, "least", "a whole number")
    target = Path(path)
    if target.suffix.lower() not in (".yaml", ".yml"):
        raise OutputError(f"{target}: map_server reads .yaml; end the name so")
    try:
        target.name.encode("utf-8")
    except UnicodeEncodeError:
        raise OutputError(f"{target}: a YAML file cannot name its image so; rename it") from None
    robot = Robot() if robot is None else robot
    if flying_height is not None:
        flight = at_height(surface, flying_height, robot, least)
        what = f"a craft from z {flight.low:g} to {flight.high:g}"
        sheet, files = _files(target, surface, flight.extent, flight.space, what)
        write_together(files, overwrite=overwrite)
        return Sheets([sheet], 0)
    found = storeys_of(surface, robot)
    if not found.storeys:
        raise UsageError(
            "the map has no floor on which such a robot can stand, or none that hangs together"
        )
    sheets: list[Sheet] = []
    all_files: dict[Path, bytes] = {}
    for number, storey in enumerate(found.storeys, 1):
        ends = np.nanmin(storey.floor), np.nanmax(storey.floor)
        what = f"storey {number}, its floor from z {ends[0]:.4g} to {ends[1]:.4g}"
        file = _numbered(target, number)
        sheet, files = _files(file, surface, found.extent, storey.space, what)
        sheets.append(sheet)
        all_files |= files
    beyond = _numbered(target, len(sheets) + 1)
    if beyond.exists():
        raise OutputError(
            f"{beyond}: is of an earlier export; the map has {len(sheets)} storeys now. Remove it"
        )
    write_together(all_files, overwrite=overwrite)
    return Sheets(sheets, found.left_out)


def refuse_sheets(path: Path, *, overwrite: bool, numbered: bool) -> None:
    """Refuse to replace the first pair, before any work is done for it; see `refuse_existing`."""
    file = _numbered(path, 1) if numbered else path
    for each in (file, file.with_suffix(".pgm")):
        refuse_existing(each, overwrite=overwrite)


def _numbered(path: Path, number: int) -> Path:
    return path.with_name(f"{path.stem}.{number}{path.suffix}")


def _files(
    file: Path, surface: SurfaceMap, extent: Extent, space: UInt8, what: str
) -> tuple[Sheet, dict[Path, bytes]]:
    """Return one sheet, and the files of which it is made."""
    import yaml

    size = surface.cell_size
    image = file.with_suffix(".pgm")
    described = {
        "image": image.name,
        "mode": "trinary",
        "resolution": size,
        "origin": [extent.min_x * size, extent.min_y * size, 0.0],
        "negate": 0,
        "occupied_thresh": OCCUPIED_ABOVE,
        "free_thresh": FREE_BELOW,
    }
    text = yaml.safe_dump(
        described, sort_keys=False, default_flow_style=None, allow_unicode=True, width=10**6
    )
    shades = np.zeros(3, dtype=np.uint8)
    for state, pixel in PIXELS.items():
        shades[state] = pixel
    head = f"P5\n{extent.width} {extent.height}\n255\n"
    files = {
        image: head.encode("ascii") + shades[space[::-1]].tobytes(),
        file: f"# {what}\n{text}".encode(),
    }
    counts = np.bincount(space.ravel(), minlength=3)
    numbers = (int(counts[state]) for state in (FREE, OCCUPIED, UNKNOWN))
    return Sheet(file, what, *numbers), files
