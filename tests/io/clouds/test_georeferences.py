"""Where on Earth files of points say that they lie.

How one could cheat: to take the geographic system that a projection of the file's own making builds
on; to take any file of positions for one that the model was aligned to, or OpenSfM's reference for
that of a reconstruction in UTM; so each has its twin that tells nothing, and says why.
"""

from __future__ import annotations

import json
from pathlib import Path

import laspy
import numpy as np
import pytest
from laspy.vlrs.vlr import VLR
from laspy.vlrs.vlrlist import VLRList

from mlscli.errors import InputError, UsageError
from mlscli.geometry.earth import local
from mlscli.io.clouds.opensfm import OpenSfmReconstruction
from mlscli.io.reading.formats import open_source
from mlscli.io.reading.recording import open_recording
from tests.io.clouds import test_opensfm
from tests.io.clouds.test_colmap import POINTS, STILL, Image, write_text

TEXT = 'PROJCS["Réseau",GEOGCS["WGS 84"]]'


def las(path: Path, *records: tuple[int, bytes], wkt: bool = False) -> Path:
    """Write points whose header has records of projection."""
    header = laspy.LasHeader(point_format=3, version="1.4")
    header.global_encoding.wkt = wkt
    header.scales = np.full(3, 0.001)
    header.vlrs.extend([VLR("LASF_Projection", number, "", data) for number, data in records])
    cloud = laspy.LasData(header)
    cloud.X = cloud.Y = cloud.Z = np.arange(9)
    cloud.write(path)
    return path


def keys(*values: int, place: int = 0) -> tuple[int, bytes]:
    """Return a directory of GeoTIFF keys, each a number and its value."""
    entries = [[key, place, 1, value] for key, value in zip(values[::2], values[1::2], strict=True)]
    return 34735, np.array([[1, 1, 0, len(entries)], *entries], dtype="<u2").tobytes()


@pytest.mark.parametrize(
    ("records", "crs"),
    [
        ([keys(1024, 1, 3072, 32618)], "EPSG:32618"),
        ([keys(3072, 25832, 4096, 7837)], "EPSG:25832+7837"),
        ([keys(1024, 2, 2048, 4258)], "EPSG:4258"),
        ([(2112, TEXT.encode() + b"\0")], TEXT),
        ([(2112, TEXT.encode("latin-1"))], TEXT),
        ([(2112, b"\0"), keys(3072, 32618)], "EPSG:32618"),
        ([(2112, TEXT.encode()), keys(3072, 32618)], "EPSG:32618"),
        ([], None),
    ],
)
def test_a_las_file_states_its_system(
    records: list[tuple[int, bytes]], crs: str | None, tmp_path: Path
) -> None:
    source = open_source(las(tmp_path / "a.las", *records))
    found = source.georeference
    assert (found and found.crs) == crs
    assert found is None or found.offset == (0, 0, 0)
    assert list(source.notes) == []
    assert len(next(iter(source.clouds())).points) == 9


def test_the_flag_of_a_las_file_says_whether_text_or_keys_count(tmp_path: Path) -> None:
    both = (2112, TEXT.encode()), keys(3072, 32618)
    found = open_source(las(tmp_path / "a.las", *both, wkt=True)).georeference
    assert found is not None
    assert found.crs == TEXT


@pytest.mark.parametrize(
    "record",
    [
        keys(3072, 32767, 2048, 4326),
        keys(3072, 32618, place=34736),
        keys(1024, 1),
        (2112, b'LOCAL_CS["a hall"]'),
    ],
)
def test_a_system_of_its_own_is_not_guessed(record: tuple[int, bytes], tmp_path: Path) -> None:
    source = open_source(las(tmp_path / "a.las", record))
    assert source.georeference is None
    assert "`crs` says which it is" in source.notes[0]


def test_a_las_file_may_state_its_system_behind_its_points(tmp_path: Path) -> None:
    path = las(tmp_path / "a.las", wkt=True)
    cloud = laspy.read(path)
    cloud.evlrs = VLRList(
        [
            VLR("other", 2112, "", b"no system"),
            VLR("LASF_Projection", 2112, "", TEXT.encode() + b"\0"),
        ]
    )
    for name in ("b.las", "b.laz"):
        cloud.write(tmp_path / name)
        source = open_source(tmp_path / name)
        assert source.georeference is not None
        assert source.georeference.crs == TEXT
        assert len(next(iter(source.clouds())).points) == 9
        whole = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(whole[: -len(TEXT) - 30])
        assert open_source(tmp_path / name).georeference is None
        # Records far beyond the file, and more than there can be.
        (tmp_path / name).write_bytes(whole[:235] + b"\xff" * 12 + whole[247:])
        assert open_source(tmp_path / name).georeference is None


def test_opensfm_lies_about_its_reference_and_says_it_inside_or_beside(tmp_path: Path) -> None:
    place = {"latitude": 47.3, "longitude": 8.5, "altitude": 600.0}
    document = {"shots": test_opensfm.SHOTS, "points": test_opensfm.POINTS}
    path = test_opensfm.write(tmp_path, [document])
    assert OpenSfmReconstruction(path).georeference is None
    crs = set()
    for name in ("reference.json", "reference_lla.json"):
        (tmp_path / name).write_text(json.dumps(place))
        found = OpenSfmReconstruction(path).georeference
        assert found is not None
        assert (found.offset, found.source) == ((0, 0, 600.0), name)
        crs.add(found.crs)
        (tmp_path / name).write_text("{")
        broken = OpenSfmReconstruction(path)
        assert broken.georeference is None
        assert "`crs` says where" in broken.notes[-2]
    inside = test_opensfm.write(tmp_path, [document | {"reference_lla": place}])
    again = OpenSfmReconstruction(inside).georeference
    assert again is not None
    assert crs == {again.crs}
    for wrong in ({}, place | {"latitude": 99}, place | {"altitude": "high"}, [1, 2, 3]):
        source = OpenSfmReconstruction(
            test_opensfm.write(tmp_path, [document | {"reference_lla": wrong}])
        )
        assert source.georeference is None
        assert "expected latitude, longitude and altitude" in source.notes[0]
    nowhere = document | {"reference_lla": dict.fromkeys(place, 0.0)}
    assert OpenSfmReconstruction(test_opensfm.write(tmp_path, [nowhere])).georeference is None


def test_opendronemap_has_moved_its_reconstruction_into_utm(tmp_path: Path) -> None:
    place = {"latitude": 47.3, "longitude": 8.5, "altitude": 600.0}
    document = {"shots": test_opensfm.SHOTS, "points": test_opensfm.POINTS, "reference_lla": place}
    path = test_opensfm.write(tmp_path / "opensfm", [document])
    (tmp_path / "opensfm" / "reconstruction.topocentric.json").write_text("[]")
    source = OpenSfmReconstruction(path)
    assert source.georeference is None
    assert "is in a map projection, less an offset" in source.notes[0]
    coords = tmp_path / "odm_georeferencing" / "coords.txt"
    coords.parent.mkdir()
    coords.write_text("WGS84 UTM 33S\n462000 5238000\n1.0 2.0 3.0\n")
    found = OpenSfmReconstruction(path).georeference
    assert found == ("EPSG:32733", (462000, 5238000, 0), "coords.txt")


def test_a_colmap_model_lies_where_its_cameras_were_aligned_to(tmp_path: Path) -> None:
    origin = (47.3, 8.5, 600.0)
    places = [(47.3 + 0.001 * n, 8.5 - 0.002 * (n % 3), 600.0 + 9 * (n % 2)) for n in range(6)]
    where = local(np.array(places), origin)
    images = [Image(n, f"{n}.jpg", STILL, tuple((-at).tolist())) for n, at in enumerate(where, 1)]
    model = write_text(tmp_path / "sparse" / "0", images, POINTS)
    assert open_source(model).georeference is None
    rows = [" ".join(map(str, (f"{n}.jpg", *place))) for n, place in enumerate(places, 1)]
    file = tmp_path / "ref_images.txt"
    file.write_text("\n".join(rows))
    source = open_source(model)
    assert source.georeference is not None
    assert source.georeference.offset == (0, 0, 600.0)
    assert "6 cameras of the model, at" in source.notes[-1]
    for broken, why in (
        ("\n".join(reversed(rows)), "the model is not aligned to it"),
        ("\n".join(rows[:2]), "2 images of the model was, too few"),
        ("EPSG:4326\n" + rows[0], "cannot be read as rows of"),
        ("1.jpg 500000 5200000 600", "cannot be read as rows of"),
    ):
        file.write_text(broken)
        source = open_source(model)
        assert source.georeference is None
        assert why in source.notes[-1]


def test_sources_that_lie_in_different_places_are_no_one_recording(tmp_path: Path) -> None:
    one = las(tmp_path / "one.las", keys(3072, 32632))
    same = las(tmp_path / "same.las", keys(1024, 1, 3072, 32632))
    other = las(tmp_path / "other.las", keys(3072, 32633))
    together = open_recording(one, same, np.zeros((3, 3))).georeference
    assert together is not None
    assert together.crs == "EPSG:32632"
    with pytest.raises(InputError, match=r"other.las: lies in EPSG:32633.*one.las in EPSG:32632"):
        _ = open_recording(one, other).georeference
    asked = open_recording(one, other, crs="EPSG:2056", crs_offset=(1, 2, 3))
    assert asked.georeference == ("EPSG:2056", (1, 2, 3), "as given")
    assert asked.options["crs"] == "EPSG:2056"
    with pytest.raises(UsageError, match=r"`crs_offset`: leads into a reference system"):
        open_recording(one, crs_offset=(1, 2, 3))
    with pytest.raises(UsageError, match="expected three numbers"):
        open_recording(one, crs="EPSG:2056", crs_offset=(1, 2))
    pytest.importorskip("pyproj")
    with pytest.raises(UsageError, match=r"`crs`: is 'EPSG:99999', which is none"):
        open_recording(one, crs="EPSG:99999")
