"""Places on Earth, held against PROJ.

How one could cheat: by a sphere, by latitude and longitude in the wrong order, by a plane at sea
level for a place high above it.
"""

from __future__ import annotations

import numpy as np
import pytest

from mlscli.geometry.earth import is_place, local, local_georeference
from mlscli.io.crs import on_earth

PLACES = [(47.3, 8.5, 600.0), (-33.9, 151.2, 5.0), (69.6, -140.1, 2500.0)]


@pytest.mark.parametrize("origin", PLACES)
def test_a_local_frame_is_that_of_proj_and_its_system_leads_back(
    origin: tuple[float, float, float],
) -> None:
    pyproj = pytest.importorskip("pyproj")
    latitude, longitude, height = origin
    points = np.array([[0, 0, 0], [300, 0, 9], [0, -400, 2], [-250, 250, 30]], dtype=np.float64)
    back = pyproj.Transformer.from_pipeline(
        f"+proj=pipeline +step +inv +proj=topocentric +ellps=WGS84 +lon_0={longitude} "
        f"+lat_0={latitude} +h_0={height} +step +inv +proj=cart +ellps=WGS84 "
        "+step +proj=unitconvert +xy_in=rad +xy_out=deg"
    )
    lon, lat, high = back.transform(*points.T)
    places = np.column_stack((lat, lon, high))
    np.testing.assert_allclose(local(places, origin), points, atol=1e-6)
    found = on_earth(local_georeference(*origin, "a test"), points)
    # In metres: a millimetre or two sideways, and what the Earth bends away within 400 m.
    np.testing.assert_allclose(local(found, origin)[:, :2], points[:, :2], atol=3e-3)
    np.testing.assert_allclose(found[:, 2], places[:, 2], atol=0.013)


def test_what_is_no_place_is_told() -> None:
    nan = float("nan")
    assert is_place(*PLACES[0])
    assert not any(map(is_place, (90.0, 0.0, nan), (0.0, 181.0, 0.0), (0.0, 0.0, 1e6)))
