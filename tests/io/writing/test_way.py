"""The way of a craft in an MCAP file, read back by rosbags.

How one could cheat: to write the line and not its colours, or those of other pieces; to leave out
the bend; to be read by the program's own reader alone.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from mlscli.errors import OutputError
from mlscli.io.writing.way import UNSEEN_GREY, way_colours, write_way
from mlscli.mesh.colours import ARTIFICIAL_RED
from mlscli.queries.clearance import BLOCKED, NEVER_SEEN, Clearance, clearance
from tests.helpers.maps import Patch, map_of


def bend() -> Clearance:
    """Return the clearance along a bend into a wall, of a map that knows no free space."""
    wall = map_of([Patch(4, iy, 3.0, 3.0, 0, 1024) for iy in range(-9, 9)])
    return clearance(wall, np.array([[-2.0, 0, 1], [0, 0, 1], [4, 1, 1.5]]), 0.6, 0.4)


def messages(path: Path) -> dict[str, Any]:
    with AnyReader([path]) as reader:
        return {
            connection.topic: reader.deserialize(raw, connection.msgtype)
            for connection, _, raw in reader.messages()
        }


def test_each_piece_is_a_line_of_its_colour(tmp_path: Path) -> None:
    found = bend()
    write_way(tmp_path / "way.mcap", found, "world")
    line = messages(tmp_path / "way.mcap")["/mls/clearance"]
    assert (line.type, line.header.frame_id) == (5, "world")
    ends = np.array([[point.x, point.y, point.z] for point in line.points]).reshape(-1, 2, 3)
    np.testing.assert_array_equal(ends[:, 0], found.pieces.place[:-1])
    np.testing.assert_array_equal(ends[:, 1], found.pieces.place[1:])
    tints = np.array([[tint.r, tint.g, tint.b] for tint in line.colors]).reshape(-1, 2, 3)
    for end in range(2):
        np.testing.assert_allclose(tints[:, end], way_colours(found) / 255, atol=1e-6)
    verdicts = set(found.verdict.tolist())
    assert verdicts >= {NEVER_SEEN, BLOCKED}
    colours = {tuple(each) for each in way_colours(found).tolist()}
    assert {ARTIFICIAL_RED, UNSEEN_GREY} <= colours


def test_the_cloud_holds_what_was_found(tmp_path: Path) -> None:
    found = bend()
    write_way(tmp_path / "way.mcap", found, "world")
    cloud = messages(tmp_path / "way.mcap")["/mls/clearance_places"]
    types = {1: "i1", 2: "u1", 6: "<u4", 7: "<f4", 8: "<f8"}
    records = np.frombuffer(
        cloud.data.tobytes(),
        np.dtype(
            {
                "names": [field.name for field in cloud.fields],
                "formats": [types[field.datatype] for field in cloud.fields],
                "offsets": [field.offset for field in cloud.fields],
                "itemsize": cloud.point_step,
            }
        ),
    )
    assert records["verdict"].tolist() == found.verdict.tolist()
    np.testing.assert_array_equal(records["distance"], found.distance)
    middle = (found.pieces.place[:-1] + found.pieces.place[1:]) / 2
    np.testing.assert_allclose(np.stack([records[axis] for axis in "xyz"], 1), middle, atol=1e-6)


def test_a_file_that_exists_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "way.mcap").write_text("mine")
    with pytest.raises(OutputError, match=r"way\.mcap: exists already"):
        write_way(tmp_path / "way.mcap", bend(), "world")
    assert (tmp_path / "way.mcap").read_text() == "mine"
