"""What the numbers of a PLY say against its header: their types, and the order of their bytes.

Ways to pass without being right: to believe the header, or to doubt it where it is right.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mlscli.io.clouds.plycloud import PlyCloud
from tests.helpers.plys import ply


@pytest.mark.parametrize("order", ["<", ">"])
def test_halves_that_are_declared_ushort_are_read_as_halves(tmp_path: Path, order: str) -> None:
    points = np.random.default_rng(3).uniform(-9, 9, (100, 3)).astype(f"{order}f2")
    path = tmp_path / "a.ply"
    header = ["element vertex 100", *(f"property ushort {axis}" for axis in "xyz")]
    name = "little" if order == "<" else "big"
    path.write_bytes(ply(f"binary_{name}_endian", *header, body=points.tobytes()))
    source = PlyCloud(path)

    (cloud,) = source.clouds()

    assert cloud.points.tolist() == points.astype(float).tolist()
    assert "hold halves" in source.notes[0]


@pytest.mark.parametrize(("stated", "order"), [("big", "<"), ("little", ">")])
@pytest.mark.parametrize("type_", ["float", "double", "short"])
def test_the_data_decide_against_the_header_in_which_order_bytes_stand(
    tmp_path: Path, stated: str, order: str, type_: str
) -> None:
    # As a scanner goes along, in millimetres.
    points = np.rint(np.cumsum(np.random.default_rng(1).normal(size=(500, 3)) * 1e3, axis=0))
    code = {"float": "f4", "double": "f8", "short": "i2"}[type_]
    body = points.astype(f"{order}{code}").tobytes()
    path = tmp_path / "a.ply"
    header = ["element vertex 500", *(f"property {type_} {axis}" for axis in "xyz")]
    path.write_bytes(ply(f"binary_{stated}_endian", *header, body=body))
    source = PlyCloud(path)
    (cloud,) = source.clouds()
    assert cloud.points.tolist() == points.astype(code).tolist()
    assert list(source.notes) == [
        f"{path}: its header says binary_{stated}_endian, but its numbers are "
        f"{'little' if stated == 'big' else 'big'}-endian, and are read so"
    ]
    path.write_bytes(
        ply(f"binary_{'little' if order == '<' else 'big'}_endian", *header, body=body)
    )
    right = PlyCloud(path)
    (cloud,) = right.clouds()
    assert cloud.points.tolist() == points.astype(code).tolist()
    assert list(right.notes) == []
