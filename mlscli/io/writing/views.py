"""Write views of an exploration as a table, and the way along them as a trajectory."""

from __future__ import annotations

import csv
import io
import math
import os
from typing import Any

import numpy as np

from mlscli.geometry.poses import looking
from mlscli.io.writing.atomic import atomic_write
from mlscli.queries.exploration import WAYS, Exploration
from mlscli.queries.uncertain import KINDS
from mlscli.runtime.arrays import Float64

SPEED = 1.0
"""Of the craft in a trajectory, in the map's unit a second; at each view it waits for a second."""


def rows_of(found: Exploration) -> list[dict[str, Any]]:
    """Return a row for each view, as tables and JSON have it."""
    rows = []
    for number, view in enumerate(found.views, 1):
        region = found.regions[view.region]
        rows.append(
            {
                "view": number,
                "kind": KINDS[region.kind],
                **dict(zip("xyz", view.place, strict=True)),
                "yaw": view.yaw,
                "tilt": view.tilt,
                **{f"{name}_cells": cells for name, cells in zip(KINDS, view.sees, strict=True)},
                "across": view.across,
                "drop": view.drop,
                "above_ground": view.ground if math.isfinite(view.ground) else None,
                "way_down": WAYS[view.way],
                "region": view.region,
                "region_cells": region.cells,
                "region_middle": list(region.middle),
            }
        )
    return rows


def table_of(found: Exploration) -> str:
    """Return a row for each view as CSV, with a header."""
    names = [*_NAMES, "region_x", "region_y", "region_z"]
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(names)
    for row in rows_of(found):
        middle = row.pop("region_middle")
        table.writerow([*("" if value is None else value for value in row.values()), *middle])
    return text.getvalue()


def write_views(
    path: str | os.PathLike[str], found: Exploration, *, overwrite: bool = False
) -> None:
    """Write the table of views, whole or not at all.

    Raises
    ------
    OutputError
        Where the file exists and `overwrite` is False, or it cannot be written.
    """
    with atomic_write(path, overwrite=overwrite) as stream:
        stream.write(table_of(found).encode())


_NAMES = (
    *("view", "kind", "x", "y", "z", "yaw", "tilt"),
    *(f"{name}_cells" for name in KINDS),
    *("across", "drop", "above_ground", "way_down", "region", "region_cells"),
)


def write_trajectory(
    path: str | os.PathLike[str], found: Exploration, *, overwrite: bool = False
) -> None:
    """Write the way along the views in the format of TUM, whole or not at all.

    Attitudes are those of `mlscli.geometry.poses.looking`.

    Raises
    ------
    OutputError
        Where the file exists and `overwrite` is False, or it cannot be written.
    """
    position, yaw, tilt = found.way()
    attitude = looking(np.radians(yaw), np.radians(tilt)) + 0.0
    lines = ["# timestamp tx ty tz qx qy qz qw\n"]
    for row in np.column_stack((times(found), position, attitude)).tolist():
        lines.append(" ".join(map(repr, row)) + "\n")
    with atomic_write(path, overwrite=overwrite) as stream:
        stream.write("".join(lines).encode())


def times(found: Exploration) -> Float64:
    """Return when the craft comes to each place of its way, in seconds, float64 (K,)."""
    position = np.vstack((found.begin, found.way()[0]))
    passed = np.linalg.norm(np.diff(position, axis=0), axis=1) / SPEED + 1.0
    return np.cumsum(passed)
