"""Write the way of a craft, coloured by its clearance, as an MCAP file of ROS 2 messages.

========================= ============================= ===========================================
topic                     type                          content
========================= ============================= ===========================================
``/mls/clearance``        visualization_msgs/Marker     a line for each piece of the way
``/mls/clearance_places`` sensor_msgs/PointCloud2       their middles, with what was found there
========================= ============================= ===========================================

Both hold one message, in the map frame. Where the craft does not fit the way is red, where that is
doubtful orange, where it was never seen grey; else from yellow, where it touches something, to
green, where nothing is in reach. RViz draws clouds in float32: far from the map frame's origin they
lose digits, but the numbers in them do not.
"""

from __future__ import annotations

import os

import numpy as np

from mlscli.io.writing.bag_messages import CLOUD_TYPE, BagWriter
from mlscli.io.writing.flight_bag import whole_bag
from mlscli.io.writing.triangle_lists import MARKER_TYPE
from mlscli.mesh.colours import ARTIFICIAL_RED
from mlscli.queries.clearance import BLOCKED, DOUBTFUL, NEVER_SEEN, Clearance
from mlscli.runtime.arrays import Array, UInt8

LINE, PLACES = "/mls/clearance", "/mls/clearance_places"

DOUBTFUL_ORANGE = (240, 130, 20)
UNSEEN_GREY = (128, 128, 136)
TOUCHING, CLEAR = (236, 214, 96), (0, 170, 60)

# How wide the line is drawn, in widths of the craft.
_WIDTH = 0.1

_PLACE = np.dtype(
    [
        *((name, "<f4") for name in "xyz"),
        ("rgb", "<u4"),
        ("along", "<f8"),
        ("distance", "<f8"),
        ("seen", "<f4"),
        ("verdict", "u1"),
    ]
)


def write_way(
    path: str | os.PathLike[str], found: Clearance, frame_id: str, *, overwrite: bool = False
) -> None:
    """Write the way of a craft, coloured by its clearance, whole or not at all.

    Parameters
    ----------
    path : path
        The file.
    found : Clearance
    frame_id : str
        The map frame.
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    OutputError
        Where the file exists or cannot be written.
    """
    colours = way_colours(found)
    ends = np.arange(2 * len(colours), dtype=np.int32).reshape(-1, 2)
    place = found.pieces.place
    corners = np.stack((place[:-1], place[1:]), axis=1).reshape(-1, 3)
    topics = {LINE: MARKER_TYPE, PLACES: CLOUD_TYPE}
    with (
        whole_bag(path, "states", overwrite=overwrite) as partial,
        BagWriter(partial, "states", topics, lasting=topics) as bag,
    ):
        width = _WIDTH * found.width
        bag.lines(LINE, 0, frame_id, corners, np.repeat(colours, 2, axis=0), ends, width)
        bag.cloud(PLACES, 0, frame_id, _places(found, colours))


def way_colours(found: Clearance) -> UInt8:
    """Return the colour of each piece, uint8 (N, 3)."""
    share = np.clip(found.distance / found.reach, 0, 1)[:, None]
    colours: UInt8 = np.rint(TOUCHING + share * np.subtract(CLEAR, TOUCHING)).astype(np.uint8)
    for verdict, colour in (
        (NEVER_SEEN, UNSEEN_GREY),
        (DOUBTFUL, DOUBTFUL_ORANGE),
        (BLOCKED, ARTIFICIAL_RED),
    ):
        colours[found.verdict == verdict] = colour
    return colours


def _places(found: Clearance, colours: UInt8) -> Array:
    """Return the middles of the pieces as `_PLACE` records (N,)."""
    records = np.zeros(len(colours), _PLACE)
    place, along = found.pieces
    for axis, name in enumerate("xyz"):
        records[name] = (place[:-1, axis] + place[1:, axis]) / 2
    records["rgb"] = colours.astype(np.uint32) @ (1 << 16, 1 << 8, 1)
    records["along"] = (along[:-1] + along[1:]) / 2
    for name in ("distance", "seen", "verdict"):
        records[name] = getattr(found, name)
    return records
