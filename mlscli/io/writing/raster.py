"""The layers of a map in files: arrays of numpy, NetCDF, and GeoTIFF."""

from __future__ import annotations

import io
import os
import zipfile
from collections.abc import Mapping
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from mlscli.errors import UsageError, expect, expect_path, one_line
from mlscli.io.crs import wkt_of
from mlscli.io.writing.atomic import atomic_write, refuse_existing
from mlscli.io.writing.npz import array_member
from mlscli.maps.georeference import Georeference, map_georeference
from mlscli.maps.surface_map import SurfaceMap
from mlscli.rasters.layers import HEIGHTS, LAYERS, Layers, layers_of
from mlscli.runtime.arrays import Float64
from mlscli.version import __version__

Kind: TypeAlias = Literal["npz", "netcdf", "geotiff"]
KINDS: tuple[Kind, ...] = get_args(Kind)

GRID_MAPPING = "crs"
"""The variable of NetCDF that holds the reference system, as the conventions CF have it."""

NO_RASTERIO = "needs rasterio, which is not installed: pip install 'mlscli[geo]'"


def write_layers(
    path: str | os.PathLike[str],
    surface: SurfaceMap,
    kind: str,
    *,
    crs: str | None = None,
    overwrite: bool = False,
) -> Layers:
    """Write the layers of a map, float64 each, as `mlscli.rasters.layers.LAYERS` lists them.

    Parameters
    ----------
    path
    surface : SurfaceMap
    kind : {"npz", "netcdf", "geotiff"}
        Arrays of numpy, with ``x`` and ``y``, the middles of the cells; NetCDF (classic, with
        64-bit offsets) of the same; or a GeoTIFF with a band for each layer, which needs rasterio.
    crs : str, optional
        Of NetCDF and GeoTIFF: the reference system of the map frame, as ``EPSG:32632``, for a map
        whose georeference is not known. Where it is known, or given, the offset that leads to it is
        added to x, y, and the heights ground and top.
    overwrite : bool

    Returns
    -------
    Layers
        What was written.

    Raises
    ------
    UsageError
        Where the map is empty, or too wide for a raster; `crs` is none, is given for another kind,
        or for a map of another system or whose axes are not those of its recording; or rasterio is
        missing.
    OutputError
        Where the file exists and `overwrite` is False, or cannot be written.
    """
    expect_path(path, "path", "the file to write")
    expect(kind, str, "kind", f"one of {', '.join(KINDS)}")
    expect(crs, (str, type(None)), "crs", "the name of a reference system, as EPSG:32632")
    if kind not in KINDS:
        raise UsageError(f"`kind`: is {kind!r}; expected one of {', '.join(KINDS)}")
    if crs is not None and kind == "npz":
        raise UsageError("`crs`: npz does not take it; netcdf and geotiff do")
    refuse_existing(path, overwrite=overwrite)
    layers = layers_of(surface)
    if kind == "npz":
        content = _npz(layers, surface)
    else:
        place = map_georeference(surface.meta, crs)
        content = (_netcdf if kind == "netcdf" else _geotiff)(layers, surface, place)
    with atomic_write(path, overwrite=overwrite) as stream:
        stream.write(content)
    return layers


def _described(surface: SurfaceMap) -> dict[str, Any]:
    return {"frame_id": surface.frame_id, "cell_size": surface.cell_size}


def _npz(layers: Layers, surface: SurfaceMap) -> bytes:
    arrays = {"x": layers.x, "y": layers.y, **layers.layers}
    arrays |= {name: np.array(value) for name, value in _described(surface).items()}
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_STORED) as archive:
        for name, values in arrays.items():
            with array_member(archive, name) as stream:
                np.lib.format.write_array(stream, values, allow_pickle=False)
    return content.getvalue()


def _raised(layers: Layers, place: Georeference | None) -> Mapping[str, Float64]:
    """Return the layers, those of heights in the reference system, if there is one."""
    if place is None or not place.offset[2]:
        return layers.layers
    return layers.layers | {name: layers.layers[name] + place.offset[2] for name in HEIGHTS}


def _netcdf(layers: Layers, surface: SurfaceMap, place: Georeference | None) -> bytes:
    from scipy.io import netcdf_file

    east, north, _ = (0.0, 0.0, 0.0) if place is None else place.offset

    content = io.BytesIO()
    file = netcdf_file(content, "w", version=2)
    file.Conventions, file.source = "CF-1.8", f"mls {__version__}"
    for name, value in _described(surface).items():
        # What is no ASCII is refused as text.
        encoded = value.encode(errors="backslashreplace") if isinstance(value, str) else value
        setattr(file, name, encoded)
    for axis, values in (("y", layers.y + north), ("x", layers.x + east)):
        file.createDimension(axis, len(values))
        variable = file.createVariable(axis, "d", (axis,))
        variable[:] = values
        variable.axis, variable.long_name = axis.upper(), f"{axis} of the cells' middles"
        if place is not None:
            variable.standard_name = f"projection_{axis}_coordinate"
    for name, values in _raised(layers, place).items():
        variable = file.createVariable(name, "d", ("y", "x"))
        variable[:] = values
        variable.long_name = LAYERS[name]
        if place is not None:
            variable.grid_mapping = GRID_MAPPING
    if place is not None:
        variable = file.createVariable(GRID_MAPPING, "i", ())
        text = wkt_of(place.crs)
        variable.spatial_ref = (text or place.crs).encode()
        if text is not None:
            variable.crs_wkt = text.encode()
    file.flush()
    written = content.getvalue()
    file.close()
    return written


def _geotiff(layers: Layers, surface: SurfaceMap, place: Georeference | None) -> bytes:
    try:
        from rasterio import Affine
        from rasterio.crs import CRS
        from rasterio.errors import CRSError
        from rasterio.io import MemoryFile
    except ImportError:
        raise UsageError(f"`kind`: geotiff {NO_RASTERIO}") from None
    system, (east, north, _) = None, (0.0, 0.0, 0.0)
    if place is not None:
        east, north, _ = place.offset
        try:
            system = CRS.from_user_input(place.crs)
        except CRSError as error:
            why = one_line(error)
            raise UsageError(f"`crs`: is {place.name!r}, which is none: {why}") from None
    extent, size = layers.extent, layers.cell_size
    corner = extent.min_x * size + east, (extent.min_y + extent.height) * size + north
    with MemoryFile() as memory:
        with memory.open(
            driver="GTiff",
            width=extent.width,
            height=extent.height,
            count=len(layers.layers),
            dtype="float64",
            nodata=np.nan,
            crs=system,
            transform=Affine(size, 0.0, corner[0], 0.0, -size, corner[1]),
            compress="deflate",
            bigtiff="if_safer",
        ) as file:
            file.update_tags(**{name: str(each) for name, each in _described(surface).items()})
            for band, (name, values) in enumerate(_raised(layers, place).items(), 1):
                file.write(values[::-1], band)
                file.set_band_description(band, name)
                file.update_tags(band, long_name=LAYERS[name])
        return bytes(memory.read())
