"""Maps as clouds in files: PCD, LAS and LAZ."""

from __future__ import annotations

import os
from pathlib import Path
from types import NoneType

import numpy as np

from mlscli.errors import UsageError, expect, expect_path
from mlscli.io.crs import wkt_of
from mlscli.io.writing.atomic import atomic_write, refuse_existing
from mlscli.io.writing.las import las_of
from mlscli.io.writing.pcd import pcd_of
from mlscli.io.writing.pointcloud import cloud_of
from mlscli.maps.georeference import Georeference, georeference_of, map_georeference
from mlscli.maps.surface_map import SurfaceMap


def write_cloud(
    path: str | os.PathLike[str],
    surface: SurfaceMap,
    kind: str | None = None,
    *,
    filled: bool = False,
    artificial: bool = True,
    as_recorded: bool = False,
    crs: str | None = None,
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
    crs : str, optional
        Of LAS: the reference system of the map frame, for a map whose georeference is not known.
        Where it is known, or given, points are in it: the offset that leads to it is added, but
        with `as_recorded`.
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
        As `cloud_of`, and as `map_georeference` for `crs`; where `kind` is neither, or the name
        does not tell; and where the map is empty, of LAS.
    OutputError
        Where the file exists and `overwrite` is False, or cannot be written.
    """
    expect_path(path, "path", "the file to write")
    expect(kind, (str, NoneType), "kind", "pcd or las")
    expect(crs, (str, NoneType), "crs", "the name of a reference system, as EPSG:32632")
    ending = Path(path).suffix.lower()
    kind = {".laz": "las"}.get(ending, ending[1:]) if kind is None else kind
    if kind not in ("pcd", "las"):
        raise UsageError(f"`kind`: is {kind!r}; expected pcd or las, or a name that ends so")
    refuse_existing(path, overwrite=overwrite)
    if crs is not None and kind == "pcd":
        raise UsageError("`crs`: pcd does not take it; las does")
    cloud = cloud_of(surface, filled=filled, artificial=artificial, as_recorded=as_recorded)
    if kind == "pcd":
        content, held = pcd_of(cloud)
    else:
        place, wkt = place_of_points(surface, crs, as_recorded=as_recorded)
        if place is not None and wkt is not None:
            cloud = cloud._replace(xyz=cloud.xyz + place.offset)
        content, held = las_of(cloud, compress=ending == ".laz", wkt=wkt)
    with atomic_write(path, overwrite=overwrite) as stream:
        stream.write(content)
    off = float(np.abs(held - cloud.xyz).max(initial=0.0))
    return len(held), off


def place_of_points(
    surface: SurfaceMap, crs: str | None, *, as_recorded: bool
) -> tuple[Georeference | None, str | None]:
    """Return where points in LAS lie on Earth, and the text that says so in the file.

    None where that is not known; and no text where the system is known by its code alone, as
    pyproj is not installed.

    Raises
    ------
    InputError, UsageError
        As `map_georeference`.
    """
    if as_recorded and crs is None:
        place = georeference_of(surface.meta)
        # Points as recorded are to lie over their own cloud: nothing is added to them.
        place = None if place is None or any(place.offset) else place
    else:
        place = map_georeference(surface.meta, crs)
    return place, None if place is None else wkt_of(place.crs)
