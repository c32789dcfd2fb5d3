"""Maps as messages of grid_map, read by rosbags and by mcap's own decoder of ROS 2.

How one could cheat: to lay matrices out so that only a reader with the same mistake finds a cell;
each cell is looked for by the formula of grid_map, in maps without symmetry.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from mlscli.errors import OutputError, UsageError
from mlscli.io.writing import grid_map
from mlscli.io.writing.grid_map import DEFINITIONS, TOPIC, TYPE, write_grid_map
from mlscli.maps.surface_map import SurfaceMap
from mlscli.rasters.layers import layers_of, level_heights
from tests.helpers.maps import Patch, map_of
from tests.helpers.meshes import house


def by_rosbags(path: Path) -> Any:
    with AnyReader([path]) as reader:
        ((connection, stamp, data),) = reader.messages()
        assert (connection.topic, connection.msgtype) == (TOPIC, TYPE)
        message: Any = reader.deserialize(data, TYPE)
    assert stamp == message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
    return message


def by_mcap(path: Path) -> Any:
    decoder = pytest.importorskip("mcap_ros2.decoder", reason="pip install mcap-ros2-support")
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[decoder.DecoderFactory()])
        ((schema, channel, _, message),) = reader.iter_decoded_messages()
        assert (channel.topic, schema.name if schema else "") == (TOPIC, TYPE)
    return message


READERS = pytest.mark.parametrize("read", [by_rosbags, by_mcap])


def at(message: Any, layer: str, x: float, y: float) -> float:
    """Return what grid_map finds at a place: its index (0, 0) has the greatest x and y."""
    info = message.info
    matrix = message.data[list(message.layers).index(layer)]
    outer, inner = matrix.layout.dim
    assert (outer.label, inner.label) == ("column_index", "row_index")
    assert (outer.stride, inner.stride) == (outer.size * inner.size, inner.size)
    middle = info.pose.position
    row = int((middle.x + info.length_x / 2 - x) / info.resolution)
    column = int((middle.y + info.length_y / 2 - y) / info.resolution)
    assert 0 <= row < inner.size == round(info.length_x / info.resolution)
    assert 0 <= column < outer.size == round(info.length_y / info.resolution)
    return float(matrix.data[column * inner.size + row])


@READERS
def test_grid_map_finds_each_cell_in_each_layer(
    read: Callable[[Path], Any], tmp_path: Path
) -> None:
    surface = house()
    written = write_grid_map(tmp_path / "a.mcap", surface)
    message = read(tmp_path / "a.mcap")
    raster = layers_of(surface)
    expected = {name.replace("ground", "elevation"): each for name, each in raster.layers.items()}
    expected |= {f"elevation_{n}": level_heights(surface, raster.extent, n) for n in (1, 2)}
    assert list(message.layers) == list(expected) == written.layers
    assert list(message.basic_layers) == ["elevation"]
    assert (message.outer_start_index, message.inner_start_index) == (0, 0)
    assert message.header.frame_id == surface.frame_id
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (6, 0)
    assert message.info.resolution == surface.cell_size
    assert (written.rows, written.columns) == (raster.extent.width, raster.extent.height)
    for name, layer in expected.items():
        for (row, column), value in np.ndenumerate(layer):
            found = at(message, name, float(raster.x[column]), float(raster.y[row]))
            np.testing.assert_equal(found, float(np.float32(value)))


def test_the_definition_is_that_of_ros_2(tmp_path: Path) -> None:
    write_grid_map(tmp_path / "a.mcap", house())
    with (tmp_path / "a.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    (schema,) = summary.schemas.values()
    text = schema.data.decode()
    for definition in DEFINITIONS.values():
        for line in definition.splitlines():
            assert line in text
    (channel,) = summary.channels.values()
    assert "durability: transient_local" in channel.metadata["offered_qos_profiles"]


def high(levels: int) -> SurfaceMap:
    return map_of([Patch(0, 0, 2.0 * n, 0.0, 0, 1) for n in range(levels)])


def test_levels_beyond_the_last_layer_are_counted(tmp_path: Path) -> None:
    written = write_grid_map(tmp_path / "a.mcap", high(11))
    assert written.left_out == 3
    assert written.layers[-1] == "elevation_7"
    assert by_rosbags(tmp_path / "a.mcap").header.stamp.sec == 0
    assert write_grid_map(tmp_path / "b.mcap", high(1)).left_out == 0


def test_what_cannot_be_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UsageError, match="empty"):
        write_grid_map(tmp_path / "a.mcap", map_of([]))
    (tmp_path / "b.mcap").write_bytes(b"mine")
    with pytest.raises(OutputError, match="exists already"):
        write_grid_map(tmp_path / "b.mcap", house())
    monkeypatch.setattr(grid_map, "_MOST_VALUES", 100)
    with pytest.raises(UsageError, match="a message can have 100"):
        write_grid_map(tmp_path / "c.mcap", house())
    assert [file.name for file in tmp_path.iterdir()] == ["b.mcap"]
