"""A map as one page for the browser, complete in itself: markup, style, program and data.

The data are arrays, laid one after the other at multiples of eight bytes, deflated and written in
base64; a header in JSON says where each begins and what it is. Coordinates are whole numbers of
small steps from an origin in the middle of the map: no visible precision is lost, even in UTM
coordinates. Whole numbers that ascend or lie close together are stored as differences, which
compress well. What follows from the patches is not stored: their places as points and lines.
"""

from __future__ import annotations

import base64
import json
import math
import os
import re
import zlib
from importlib import resources
from typing import Any

import numpy as np

from mlscli.errors import OutputError, expect, expect_path
from mlscli.io.writing.atomic import atomic_write
from mlscli.keyframes.keyframe import require_points
from mlscli.maps.surface_map import ORIGINS, SurfaceMap
from mlscli.mesh.colours import ROUTE_GREEN, height_scale
from mlscli.queries.clearance import Clearance
from mlscli.queries.exploration import Exploration
from mlscli.runtime.arrays import Array, Float64, Int64
from mlscli.view.colourings import colourings
from mlscli.view.fitting import COLOURS, STEPS, Beyond, first_craft, seen_runs
from mlscli.view.layers import Picture, picture

SCRIPTS = (
    "data.js",
    "elements.js",
    "camera.js",
    "coarse.js",
    "cut.js",
    "scene.js",
    "detail.js",
    "panel.js",
    "flight.js",
    "marks.js",
    "ruler.js",
    "clearance.js",
    "craft.js",
    "picture.js",
    "address.js",
    "frame.js",
    "hands.js",
    "page.js",
)

# What JavaScript calls the types of arrays.
_TYPES = {"i4": "Int32Array", "u4": "Uint32Array", "u1": "Uint8Array", "f4": "Float32Array",
          "f8": "Float64Array"}  # fmt: skip

# Browsers limit the length of a string to 2^29 characters or somewhat less.
_LARGEST_BYTES = 400_000_000

# Steps that places on the mesh are stored in, of a cell.
_STEPS = 1024

# The first view holds the patches between these percentiles, not every stray one.
_PLACE_PERCENTILES = (1, 99)


def write_page(
    path: str | os.PathLike[str],
    surface: SurfaceMap,
    *,
    title: str = "map",
    points: Float64 | None = None,
    explored: Exploration | None = None,
    fitted: Clearance | None = None,
    overwrite: bool = False,
) -> dict[str, int]:
    """Write the page of a map, whole or not at all.

    Parameters
    ----------
    path : path-like
        The HTML file.
    surface : SurfaceMap
    title : str
        The title of the page.
    points : float64 (N, 3), optional
        Points to show with the map, in the map frame.
    explored : Exploration, optional
        Views of the map to show with it.
    fitted : Clearance, optional
        The way of a craft to show, coloured by its clearance.
    overwrite : bool
        Whether an existing file is replaced.

    Returns
    -------
    dict of str to int
        The number of elements of each layer, by its name.

    Raises
    ------
    OutputError
        Where the file exists and `overwrite` is False, it cannot be written, or the map is too
        large for a page.
    """
    expect_path(path, "path", "the file to write")
    expect(surface, SurfaceMap, "surface", "a map (SurfaceMap)")
    expect(title, str, "title", "a text")
    if points is not None:
        require_points(points, "points")
    expect(explored, (Exploration, type(None)), "explored", "an exploration (Exploration)")
    expect(fitted, (Clearance, type(None)), "fitted", "a clearance (Clearance)")
    shown = picture(surface, points, explored=explored, fitted=fitted)
    header, data = _pack(surface, shown, title)
    if len(data) > _LARGEST_BYTES:
        raise OutputError(
            f"{path}: the page would hold {len(data):,} bytes of data, and browsers take "
            f"{_LARGEST_BYTES:,}; crop the map, or choose a larger cell size"
        )
    with atomic_write(path, overwrite=overwrite) as stream:
        stream.write(_filled(header, data))
    return {layer.name: len(layer.elements) for layer in shown.layers}


def _filled(header: dict[str, Any], data: bytes) -> bytes:
    """Return the page: the template with style, scripts, header and data filled in."""
    folder = resources.files("mlscli.view") / "web"

    def part(name: str) -> str:
        return (folder / name).read_text(encoding="utf-8")

    # No text from the map can close the HTML element that holds the header.
    header_text = json.dumps(header, allow_nan=False).replace("<", "\\u003c")
    content = {
        "STYLE": part("page.css").encode(),
        "SCRIPT": "\n".join(map(part, SCRIPTS)).encode(),
        "HEADER": header_text.encode(),
        "DATA": data,
    }
    # In one pass, so that no text from the map is taken for a mark.
    text, *marked = re.split(rf"/\*({'|'.join(content)})\*/", part("page.html"))
    filled = [text.encode()]
    for mark, text in zip(marked[::2], marked[1::2], strict=True):
        filled += [content[mark], text.encode()]
    return b"".join(filled)


def _pack(surface: SurfaceMap, shown: Picture, title: str) -> tuple[dict[str, Any], bytes]:
    """Return the header and the data in base64."""
    pieces = _Pieces()
    cell_size = surface.cell_size
    low, high = _box(shown.vertices["patches"].position)
    origin = (low + high) / 2
    # Numbers are told with so many digits behind the point, and stored with one more.
    digits = max(0, min(6, 2 - math.floor(math.log10(cell_size))))
    told = 10.0 ** -(digits + 1)
    vertices = {}
    for name, (position, colour, patch) in shown.vertices.items():
        vertices[name] = {"colour": pieces.add(colour)}
        if patch is not None:
            vertices[name]["patch"] = pieces.add_differences(patch)
        if name != "patches":
            vertices[name]["position"] = pieces.add_steps(position - origin, cell_size / _STEPS)
    layers = [
        {
            "name": layer.name,
            "vertices": layer.vertices,
            "corners": layer.elements.shape[1],
            "elements": pieces.add_elements(layer.elements),
            "when": pieces.add_differences(layer.when),
            "shown": layer.shown,
        }
        for layer in shown.layers
    ]
    patches = {
        name: pieces.add_differences(getattr(surface, name))
        for name in ("ix", "iy", "first_keyframe", "last_keyframe")
    }
    patches |= {name: pieces.add(getattr(surface, name)) for name in ("origin", "moved", "count")}
    patches["height"] = pieces.add_steps(surface.height - origin[2], told)
    # What is vertical stays so, however low it is.
    upright = surface.depth > 0
    depth = np.where(upright, np.maximum(surface.depth, told), 0.0)
    patches["depth"] = pieces.add_steps(depth, told)
    beyond = Beyond.of(surface, told)
    for name, reach in zip(beyond._fields, beyond, strict=True):
        patches[name] = pieces.add_differences(reach)
    seen = seen_runs(surface)
    ways = [
        {
            "name": way.name,
            "label": way.label,
            "ends": way.ends,
            "kinds": way.kinds,
            "colour": pieces.add(way.colour),
        }
        for way in colourings(surface)
    ]
    times = surface.route[:, 0]
    known = np.isfinite(times)
    header = {
        "title": title,
        "frame": surface.frame_id,
        "cell_size": cell_size,
        "digits": digits,
        "origin": origin.tolist(),
        "box": [(low - origin).tolist(), (high - origin).tolist()],
        "scale": [int(channel) for channel in height_scale()[::15].ravel()],
        "green": ROUTE_GREEN,
        "origins": ORIGINS,
        "keyframes": len(surface.route),
        "times": (times - times[0]).tolist() if len(times) and known.all() else None,
        "colourings": ways,
        "vertices": vertices,
        "layers": layers,
        "patches": patches,
        "craft": [round(size, digits) for size in first_craft(surface)],
        "beyond": cell_size / STEPS,
        "fitting": {name: list(colour) for name, colour in COLOURS.items()},
        "seen": None
        if seen is None
        else {name: pieces.add_differences(array) for name, array in seen.items()},
    }
    return header, pieces.packed()


def _box(place: Float64) -> tuple[Float64, Float64]:
    """Return the least and the greatest corner (3,) of a box that holds most places (N, 3)."""
    if not len(place):
        return np.zeros(3), np.zeros(3)
    low, high = np.percentile(place, _PLACE_PERCENTILES, axis=0)
    return low, high


class _Pieces:
    """Arrays one after the other, each described by a row for the header.

    A row has the `type` of an array, where it `begin`s in bytes, and its `length` in elements.
    Where it has `columns`, differences are stored, of each row of so many from the one before;
    `fan`: of all columns but the first from that. Where it has a `step`, its numbers are whole ones
    times that.
    """

    def __init__(self) -> None:
        self._compress = zlib.compressobj(6)
        self._chunks: list[bytes] = []
        self._size = 0

    def add(self, array: Array, **how: Any) -> dict[str, Any]:
        """Add an array as it is, and return the row that describes it."""
        array = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<"))
        row = {"type": _TYPES[array.dtype.str[1:]], "begin": self._size, "length": array.size}
        content = array.tobytes()
        padding = b"\0" * (-len(content) % 8)
        self._chunks.append(self._compress.compress(content + padding))
        self._size += len(content) + len(padding)
        return row | how

    def add_differences(self, array: Array, **how: Any) -> dict[str, Any]:
        """Add integers (N,) or (N, C) within int32, each as its difference from the row before."""
        # A difference may wrap around; the sum then wraps back.
        whole = array.astype(np.int32)
        steps = np.diff(whole, axis=0, prepend=np.zeros_like(whole[:1]))
        return self.add(steps, columns=1 if whole.ndim == 1 else whole.shape[1], **how)

    def add_steps(self, numbers: Float64, step: float) -> dict[str, Any]:
        """Add numbers (N,) or (N, C), rounded to steps; as float32, where there are too many."""
        whole = np.rint(numbers / step)
        if np.abs(whole).max(initial=0) < 2**31:
            return self.add_differences(whole, step=step)
        with np.errstate(over="ignore"):
            return self.add(numbers.astype(np.float32))

    def add_elements(self, elements: Int64) -> dict[str, Any]:
        """Add the corners of elements (E, K): the first one's differences, the others' from it."""
        corners = elements.shape[1]
        if corners == 3:
            # Whichever corner comes first, the triangle is the same.
            turn = (elements.argmin(axis=1)[:, None] + np.arange(3)) % 3
            elements = np.take_along_axis(elements, turn, axis=1)
        fan = elements.copy()
        fan[:, 1:] -= elements[:, :1]
        fan[:, 0] = np.diff(elements[:, 0], prepend=0)
        return self.add(fan.astype(np.int32), columns=corners, fan=True)

    def packed(self) -> bytes:
        """Return all arrays, deflated, in base64; nothing can be added after this."""
        self._chunks.append(self._compress.flush())
        return base64.b64encode(b"".join(self._chunks))
