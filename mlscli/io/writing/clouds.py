"""Maps as clouds in files: PCD, LAS and LAZ."""

from __future__ import annotations

import os
from pathlib import Path
from types import NoneType

import numpy as np

from mlscli.errors import UsageError, expect, expect_path
from mlscli.io.writing.atomic import atomic_write, refuse_existing
from mlscli.io.writing.las import las_of
from mlscli.io.writing.pcd import pcd_of
from mlscli.io.writing.pointcloud import cloud_of
from mlscli.maps.surface_map import SurfaceMap


def write_cloud(
    path: str | os.PathLike[str],
    surface: SurfaceMap,
    kind: str | None = None,
    *,
    filled: bool = False,
    artificial: bool = True,
    as_recorded: bool = False,
    overwrite: bool = False,
) -> tuple[int, float]:
    """Write the patches of a map as points with fields.

    Parameters
    ----------
    path
    surface : SurfaceMap
    kind : {"pcd", "las"}, optional
        By default what the name ends in: ``.pcd``, ``.las``, or ``.laz``, which is LAS compressed.
    filled, artificial, as_recorded : bool
        As `mlscli.io.writing.pointcloud.cloud_of` has them.
    overwrite : bool

    Returns
    -------
    points : int
        How many there are.
    off : float
        By how much a coordinate is rounded at most, in the unit of the map.

    Raises
    ------
    InputError, UsageError
        As `cloud_of`; where `kind` is neither, or the name does not tell; and where the map is
        empty, of LAS.
    OutputError
        Where the file exists and `overwrite` is False, or cannot be written.
    """
    expect_path(path, "path", "the file to write")
    expect(kind, (str, NoneType), "kind", "pcd or las")
    ending = Path(path).suffix.lower()
    kind = {".laz": "las"}.get(ending, ending[1:]) if kind is None else kind
    if kind not in ("pcd", "las"):
        raise UsageError(f"`kind`: is {kind!r}; expected pcd or las, or a name that ends so")
    refuse_existing(path, overwrite=overwrite)
    cloud = cloud_of(surface, filled=filled, artificial=artificial, as_recorded=as_recorded)
    content, held = pcd_of(cloud) if kind == "pcd" else las_of(cloud, compress=ending == ".laz")
    with atomic_write(path, overwrite=overwrite) as stream:
        stream.write(content)
    return len(held), float(np.abs(held - cloud.xyz).max(initial=0.0))
