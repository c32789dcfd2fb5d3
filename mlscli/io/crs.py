"""Reference systems looked up by PROJ, if pyproj is installed (`pip install 'mlscli[geo]'`)."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from mlscli.errors import UsageError, one_line, shorten
from mlscli.maps.georeference import Georeference
from mlscli.runtime.arrays import Float64

NO_PYPROJ = "needs pyproj, which is not installed: pip install 'mlscli[geo]'"


def _system(crs: str) -> Any:
    """Return a system as pyproj has it; None where pyproj is not installed.

    Raises
    ------
    UsageError
        There is no such system.
    """
    try:
        from pyproj import CRS
        from pyproj.exceptions import CRSError
    except ImportError:
        return None
    try:
        return CRS.from_user_input(crs)
    except CRSError as error:
        raise UsageError(f"`crs`: is {shorten(crs)!r}, which is none: {one_line(error)}") from None


def require_known(crs: str) -> None:
    """Refuse a system that there is not, as far as this can be told.

    Raises
    ------
    UsageError
        pyproj is installed, and knows no such system.
    """
    _system(crs)


def wkt_of(crs: str) -> str | None:
    """Return the text (WKT 1) of a system; None where only its code is known, without pyproj.

    Raises
    ------
    UsageError
        There is no such system.
    """
    if not crs.startswith("EPSG:"):
        return crs
    system = _system(crs)
    return None if system is None else str(system.to_wkt("WKT1_GDAL"))


def on_earth(georeference: Georeference, points: Float64) -> Float64:
    """Return latitude and longitude (degrees, WGS 84) and height (m) of points.

    Heights are measured from where those of the points are: the ellipsoid, or the sea.

    Parameters
    ----------
    georeference : Georeference
        Of the frame of the points.
    points : float64 (N, 3)

    Returns
    -------
    float64 (N, 3)

    Raises
    ------
    UsageError
        pyproj is not installed, there is no such system, it has no lengths for x and y, or points
        lie beyond it.
    """
    transform, metres = _to_degrees(georeference.crs)
    x, y, z = (points + georeference.offset).T
    longitude, latitude = transform.transform(x, y)
    places = np.column_stack((latitude, longitude, metres * z))
    if not np.isfinite(places).all():
        raise UsageError(f"the map lies beyond what its reference system covers, {georeference}")
    return places


@cache
def _to_degrees(crs: str) -> tuple[Any, float]:
    """Return what leads from x and y of a system to longitude and latitude, and its metres in z."""
    system = _system(crs)
    if system is None:
        raise UsageError(f"a place in degrees {NO_PYPROJ}")
    from pyproj import Transformer

    level, heights = system, system.axis_info[2:]
    if system.is_compound:
        level, vertical = system.sub_crs_list[:2]
        heights = vertical.axis_info
    if not level.is_projected:
        raise UsageError(f"`crs`: is {shorten(crs)!r}, whose x and y are no lengths on a plane")
    # Without heights of its own, a system has them in the unit of its plane.
    unit = (heights or level.axis_info)[0].unit_conversion_factor
    transform = Transformer.from_crs(level.to_2d(), "EPSG:4326", always_xy=True)
    return transform, float(unit)
