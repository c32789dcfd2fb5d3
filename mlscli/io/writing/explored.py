"""Write what an exploration found as an MCAP file of ROS 2 messages, for RViz and Foxglove.

======================== ============================= ==========================================
topic                    type                          content
======================== ============================= ==========================================
``/mls/explore``         nav_msgs/Path                 the way along the views, with attitudes
``/mls/explore_views``   visualization_msgs/Marker     the way, and from each view the middle and
                                                       the rim of what its camera looks at
``/mls/explore_cells``   sensor_msgs/PointCloud2       the uncertain cells, by kind and region
======================== ============================= ==========================================

Each holds one message, in the map frame. Attitudes are those of a craft (x ahead, y left, z up)
whose camera looks along its -z.
"""

from __future__ import annotations

import os
from typing import NamedTuple

import numpy as np

from mlscli.geometry.poses import looking, matrices, turn
from mlscli.io.ros import NANOSECONDS
from mlscli.io.writing.bag_messages import CLOUD_TYPE, PATH_TYPE, BagWriter
from mlscli.io.writing.flight_bag import whole_bag
from mlscli.io.writing.triangle_lists import MARKER_TYPE
from mlscli.io.writing.views import times
from mlscli.mesh.colours import ARTIFICIAL_RED
from mlscli.queries.exploration import Exploration
from mlscli.runtime.arrays import Array, Float64, Int32, UInt8

WAY, VIEWS, CELLS = "/mls/explore", "/mls/explore_views", "/mls/explore_cells"

# Of each kind of uncertainty: artificial, hole, unseen, edge.
KIND_COLOURS = np.array(
    [ARTIFICIAL_RED, (200, 60, 200), (110, 70, 220), (240, 130, 20)], dtype=np.uint8
)
WAY_BLUE = (40, 130, 240)

# How far from a view its rim is drawn, and how wide lines are, in shares of the camera's range.
_RIM, _WIDTH = 0.08, 0.003
_CORNERS = 8

_CELL = np.dtype([*((name, "<f4") for name in "xyz"), ("rgb", "<u4"), ("region", "<i4"),
                  ("low", "<f8"), ("high", "<f8"), ("kind", "u1")])  # fmt: skip


class Drawing(NamedTuple):
    """Lines that show where views are, and where they look.

    Attributes
    ----------
    vertices : float64 (V, 3)
        In the frame of the map.
    colours : uint8 (V, 3)
    ends : int32 (L, 2)
        Indices of vertices.
    """

    vertices: Float64
    colours: UInt8
    ends: Int32


def drawing(found: Exploration) -> Drawing:
    """Return the way along the views, and of each view a cone and a line to what it looks at."""
    position, yaw, tilt = found.way()
    way = np.vstack((found.begin, position))
    colours = [np.tile(np.array(WAY_BLUE, dtype=np.uint8), (len(way), 1))]
    ends = [np.column_stack((np.arange(len(way) - 1), np.arange(1, len(way))))]
    vertices, held = [way], len(way)
    around = np.arange(_CORNERS) * (2 * np.pi / _CORNERS)
    half = np.radians(found.camera.field_of_view / 2)
    # Corners of the rim of a camera that looks straight down.
    rim = np.column_stack((np.sin(half) * np.cos(around), np.sin(half) * np.sin(around),
                           np.full(_CORNERS, -np.cos(half))))  # fmt: skip
    turns = matrices(looking(np.radians(yaw), np.radians(tilt)))
    for n, view in enumerate(found.views):
        region = found.regions[view.region]
        place = np.array(view.place)
        corners = place + _RIM * found.camera.reach * turn(turns[3 * n + 1], rim)
        vertices.append(np.vstack((place, region.middle, corners)))
        colours.append(np.tile(KIND_COLOURS[region.kind], (2 + _CORNERS, 1)))
        first = held + 2
        numbers = first + np.arange(_CORNERS)
        ends.append(np.array([[held, held + 1]]))
        ends.append(np.column_stack((numbers, np.roll(numbers, 1))))
        ends.append(np.column_stack((np.full(_CORNERS, held), numbers)))
        held += 2 + _CORNERS
    return Drawing(np.vstack(vertices), np.vstack(colours), np.vstack(ends).astype(np.int32))


def write_explored(
    path: str | os.PathLike[str],
    found: Exploration,
    frame_id: str,
    cell_size: float,
    *,
    overwrite: bool = False,
) -> None:
    """Write views, their way and the uncertain cells, whole or not at all.

    Parameters
    ----------
    path : path
        The file.
    found : Exploration
    frame_id : str
        The map frame.
    cell_size : float
        Side of its cells.
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    OutputError
        Where the file exists or cannot be written.
    """
    position, yaw, tilt = found.way()
    attitude = looking(np.radians(yaw), np.radians(tilt))
    stamps = np.rint(times(found) * NANOSECONDS).astype(np.int64).tolist()
    shown = drawing(found)
    topics = {WAY: PATH_TYPE, VIEWS: MARKER_TYPE, CELLS: CLOUD_TYPE}
    with (
        whole_bag(path, "states", overwrite=overwrite) as partial,
        BagWriter(partial, "states", topics, lasting=topics) as bag,
    ):
        bag.path(WAY, 0, frame_id, stamps, position, attitude)
        width = _WIDTH * found.camera.reach
        bag.lines(VIEWS, 0, frame_id, shown.vertices, shown.colours, shown.ends, width)
        bag.cloud(CELLS, 0, frame_id, _cells(found, cell_size))


def _cells(found: Exploration, cell_size: float) -> Array:
    """Return the uncertain cells as `_CELL` records (N,)."""
    cells = found.uncertain
    records = np.zeros(len(cells.kind), _CELL)
    for axis, values in zip("xyz", cells.places(cell_size).T, strict=True):
        records[axis] = values
    records["rgb"] = KIND_COLOURS[cells.kind].astype(np.uint32) @ (1 << 16, 1 << 8, 1)
    for name in ("region", "low", "high", "kind"):
        records[name] = getattr(cells, name)
    return records
