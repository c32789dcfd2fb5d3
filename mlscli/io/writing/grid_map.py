"""Maps as grid_map_msgs/GridMap, one message in an MCAP file of ROS 2 messages.

The layout is that of ANYbotics's grid_map: matrices column by column, the first row that of the
greatest x, the first column that of the greatest y.
"""

from __future__ import annotations

import os
from typing import Any, NamedTuple

import numpy as np

from mlscli.errors import UsageError, expect_path
from mlscli.io.ros import NANOSECONDS, usual_types
from mlscli.io.writing.bag_messages import lasting_profiles
from mlscli.io.writing.flight_bag import nanoseconds, whole_bag
from mlscli.io.writing.mcap_states import StateWriter
from mlscli.maps.surface_map import SurfaceMap
from mlscli.rasters.layers import layers_of, level_heights
from mlscli.runtime.arrays import Float64

TOPIC, TYPE, INFO = "/mls/grid_map", "grid_map_msgs/msg/GridMap", "grid_map_msgs/msg/GridMapInfo"

DEFINITIONS = {
    INFO: "float64 resolution\nfloat64 length_x\nfloat64 length_y\ngeometry_msgs/Pose pose\n",
    TYPE: (
        "std_msgs/Header header\ngrid_map_msgs/GridMapInfo info\nstring[] layers\n"
        "string[] basic_layers\nstd_msgs/Float32MultiArray[] data\nuint16 outer_start_index\n"
        "uint16 inner_start_index\n"
    ),
}
"""The messages as ROS 2 has them since Humble."""

MOST_LEVELS = 8
"""So many levels have a layer of their own."""

# Layers whose name differs from that of `mlscli.rasters.layers`.
_NAMES = {"ground": "elevation"}
_MOST_VALUES = 2**28


class GridMap(NamedTuple):
    """What was written.

    Attributes
    ----------
    rows, columns : int
        How many cells there are along x and along y.
    layers : list of str
    left_out : int
        Patches of levels that have no layer.
    """

    rows: int
    columns: int
    layers: list[str]
    left_out: int


def write_grid_map(
    path: str | os.PathLike[str], surface: SurfaceMap, *, overwrite: bool = False
) -> GridMap:
    """Write a map as a message of grid_map, in MCAP.

    The layers are those of `mlscli.rasters.layers.LAYERS`, ``ground`` by the name ``elevation``,
    and the heights of the levels above, ``elevation_1`` and so on, up to `MOST_LEVELS` in all. The
    message is stamped with the last time of the route, 0 where there is none.

    Parameters
    ----------
    path
        Usually ends in ``.mcap``.
    surface : SurfaceMap
    overwrite : bool

    Returns
    -------
    GridMap

    Raises
    ------
    UsageError
        Where the map is empty, or too wide for a raster.
    OutputError
        Where the file exists and `overwrite` is False, or cannot be written.
    """
    expect_path(path, "path", "the file to write")
    extent, _, layers = layers_of(surface)
    most = int(np.diff(surface.cells.start).max())
    matrices = {_NAMES.get(name, name): layer for name, layer in layers.items()}
    levels = range(1, min(most, MOST_LEVELS))
    values = extent.width * extent.height * (len(matrices) + len(levels))
    if values > _MOST_VALUES:
        raise UsageError(
            f"the map makes {values:,} values in {len(matrices) + len(levels)} layers; a message "
            f"can have {_MOST_VALUES:,}. Build it with larger cells, or without what lies far "
            "away: `crop`"
        )
    matrices |= {f"elevation_{level}": level_heights(surface, extent, level) for level in levels}
    sizes = np.diff(surface.cells.start)
    left_out = int(np.maximum(sizes - MOST_LEVELS, 0).sum())
    times = surface.route[:, 0]
    known = times[np.isfinite(times) & (times >= 0) & (times < 2**31)]
    stamp = nanoseconds(float(known[-1])) if len(known) else 0
    with whole_bag(path, "states", overwrite=overwrite) as target:
        message = _Message(surface)
        with StateWriter(target, message.store) as bag:
            topic = bag.add_topic(TOPIC, TYPE, {"offered_qos_profiles": lasting_profiles()})
            middle = [
                (least + size / 2) * surface.cell_size
                for least, size in ((extent.min_x, extent.width), (extent.min_y, extent.height))
            ]
            bag.write(topic, stamp, message.of(matrices, middle, stamp))
    return GridMap(extent.width, extent.height, list(matrices), left_out)


class _Message:
    """Makes the message of a map."""

    def __init__(self, surface: SurfaceMap) -> None:
        from rosbags.typesys import get_types_from_msg

        self.store = usual_types(is_ros1=False)
        for type_, text in DEFINITIONS.items():
            self.store.register(get_types_from_msg(text, type_))
        self._types: Any = self.store.types
        self._surface = surface

    def of(self, matrices: dict[str, Float64], middle: list[float], stamp: int) -> bytes:
        """Return the message, serialized."""
        rows, columns = next(iter(matrices.values())).shape[::-1]
        seconds, rest = divmod(stamp, NANOSECONDS)
        new, size = self._new, self._surface.cell_size
        message = new(
            TYPE,
            header=new(
                "std_msgs/msg/Header",
                stamp=new("builtin_interfaces/msg/Time", sec=seconds, nanosec=rest),
                frame_id=self._surface.frame_id,
            ),
            info=new(
                INFO,
                resolution=size,
                length_x=rows * size,
                length_y=columns * size,
                pose=new(
                    "geometry_msgs/msg/Pose",
                    position=new("geometry_msgs/msg/Point", x=middle[0], y=middle[1], z=0.0),
                    orientation=new("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
                ),
            ),
            layers=list(matrices),
            basic_layers=["elevation"],
            data=[self._matrix(matrix) for matrix in matrices.values()],
            outer_start_index=0,
            inner_start_index=0,
        )
        return bytes(self.store.serialize_cdr(message, TYPE))

    def _matrix(self, matrix: Float64) -> Any:
        """Return a layer, row by row along x from low y up, as grid_map lays it out."""
        columns, rows = matrix.shape
        dimensions = [
            self._new(
                "std_msgs/msg/MultiArrayDimension", label=label, size=size, stride=stride
            )
            for label, size, stride in (
                ("column_index", columns, rows * columns), ("row_index", rows, rows)
            )
        ]  # fmt: skip
        return self._new(
            "std_msgs/msg/Float32MultiArray",
            layout=self._new("std_msgs/msg/MultiArrayLayout", dim=dimensions, data_offset=0),
            data=matrix[::-1, ::-1].astype(np.float32).ravel(),
        )

    def _new(self, type_: str, **fields: Any) -> Any:
        return self._types[type_](**fields)
