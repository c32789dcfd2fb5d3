"""Where on Earth the frame of an OpenSfM reconstruction lies.

OpenSfM builds in a frame with x east, y north and z up about a reference, which the reconstruction
holds, and in older versions the file reference_lla.json, or reference.json, beside it.
OpenDroneMap replaces the reconstruction by one in UTM, less an offset that it writes into
odm_georeferencing/coords.txt, and keeps the first as reconstruction.topocentric.json; the
reference stays in both.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mlscli.errors import MlsError, printable, shorten
from mlscli.geometry.earth import is_place, local_georeference
from mlscli.io.files import read_input
from mlscli.maps.georeference import Georeference

_KEY = "reference_lla"
_LLA = ("latitude", "longitude", "altitude")
_BESIDE = ("reference_lla.json", "reference.json")
_TOPOCENTRIC, _PROJECTED = "reconstruction.topocentric.json", "reconstruction.geocoords.json"
_COORDS = Path("odm_georeferencing", "coords.txt")
_ZONE = re.compile(r"WGS\s?84\s+UTM\s+(\d{1,2})\s*([NS])", re.IGNORECASE)


def georeference_of(
    path: Path, reconstruction: Mapping[str, Any]
) -> tuple[Georeference | None, list[str]]:
    """Return the georeference of a reconstruction, and notes on what cannot be used.

    Parameters
    ----------
    path : Path
        Its file.
    reconstruction : mapping
        The one that is taken of those that the file holds.
    """
    if path.name != _TOPOCENTRIC and (
        path.name == _PROJECTED or path.with_name(_TOPOCENTRIC).exists()
    ):
        return _of_projected(path)
    if _KEY in reconstruction:
        return _of_reference(reconstruction[_KEY], path, f": {_KEY}")
    for name in _BESIDE:
        beside = path.with_name(name)
        if beside.exists():
            try:
                held = json.loads(read_input(beside))
            except (MlsError, OSError, ValueError, RecursionError):
                return None, [f"{beside}: is no whole JSON file; `crs` says where the map lies"]
            return _of_reference(held, beside)
    return None, []


def _of_reference(held: Any, path: Path, key: str = "") -> tuple[Georeference | None, list[str]]:
    try:
        latitude, longitude, altitude = (float(held[key]) for key in _LLA)
    except (KeyError, TypeError, ValueError, OverflowError):
        latitude = longitude = altitude = math.nan
    # False for NaN, too.
    if not is_place(latitude, longitude, altitude):
        return None, [
            f"{path}{key}: found {shorten(printable(str(held)))}, expected latitude, longitude and "
            "altitude; `crs` says where the map lies"
        ]
    # Without GPS, OpenSfM states this.
    if latitude == longitude == altitude == 0:
        return None, []
    return local_georeference(latitude, longitude, altitude, path.name), []


def _of_projected(path: Path) -> tuple[Georeference | None, list[str]]:
    """Return that of OpenDroneMap's reconstruction in UTM, by what it wrote for all its parts."""
    coords = path.resolve().parent.parent / _COORDS
    try:
        zone, offset, *_ = [*read_input(coords)[:1000].decode("utf-8", "replace").splitlines(), ""]
        east, north = map(float, offset.split())
    except (MlsError, OSError, ValueError):
        zone, east, north = "", math.nan, math.nan
    found = _ZONE.match(zone.strip())
    if found and 1 <= int(found[1]) <= 60 and math.isfinite(east + north):
        code = (32600 if found[2].upper() == "N" else 32700) + int(found[1])
        return Georeference(f"EPSG:{code}", (east, north, 0.0), coords.name), []
    return None, [
        f"{path}: is in a map projection, less an offset, and {coords} does not tell which: it "
        "begins with WGS84 UTM and the zone, and then the offset; `crs` says where the map lies"
    ]
