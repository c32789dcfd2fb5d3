"""Colours of maps: heights from blue to brown, plastered lighter, artificial red.

The height scale runs blue, green, yellow, orange, brown at equal steps of perceived difference:
its anchors are joined by straight lines in the Oklab space, and its entries lie evenly along
them. Red is reserved for artificial patches, and a strong green for the route.

Variance, uncertainty, count and time use the same scale. Inserted patches have no such value:
plastered ones are pale, artificial ones red. Regions with successive numbers have hues that lie far
apart.

References
----------
B. Ottosson, *A perceptual color space for image processing*, 2020 (Oklab).
"""

from __future__ import annotations

from functools import cache
from typing import Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from mlscli.maps.surface_map import ARTIFICIAL, MEASURED, PLASTERED, SurfaceMap
from mlscli.runtime.arrays import Float64, Int32, Int64, UInt8

ColourBy: TypeAlias = Literal[
    "height", "origin", "variance", "uncertainty", "count", "region", "time"
]
COLOURS: tuple[ColourBy, ...] = get_args(ColourBy)

ARTIFICIAL_RED = (224, 16, 32)
ROUTE_GREEN = (0, 200, 60)
WHITE = (255, 255, 255)
# The colour of patches that have no value on the scale, or no region.
PALE = (214, 214, 208)

ANCHORS = (
    (34, 62, 158),
    (36, 124, 168),
    (96, 172, 128),
    (236, 214, 96),
    (232, 154, 62),
    (150, 90, 36),
)
COLOUR_STEPS = 256

# A height this near (in cells) to another is the same: they differ by rounding.
SNAP = 1e-6

# Heights beyond these percentiles take the end colours, so that a few outliers do not use up
# the scale.
HEIGHT_PERCENTILES = (2.0, 98.0)

_LMS_FROM_RGB = np.array(
    [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ]
)
_LAB_FROM_LMS = np.array(
    [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ]
)


def oklab(rgb: UInt8) -> Float64:
    """Convert sRGB colours, uint8 (N, 3), to Oklab, float64 (N, 3): lightness 0 to 1, a, b."""
    encoded = rgb / 255
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    lab: Float64 = np.cbrt(linear @ _LMS_FROM_RGB.T) @ _LAB_FROM_LMS.T
    return lab


def from_oklab(lab: Float64) -> UInt8:
    """Convert Oklab colours, float64 (N, 3), to sRGB, uint8 (N, 3), clipped to the sRGB gamut."""
    linear = (lab @ np.linalg.inv(_LAB_FROM_LMS).T) ** 3 @ np.linalg.inv(_LMS_FROM_RGB).T
    linear = np.clip(linear, 0, 1)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    rgb: UInt8 = np.rint(np.clip(encoded, 0, 1) * 255).astype(np.uint8)
    return rgb


@cache
def height_scale() -> UInt8:
    """Return the colours of the scale, low to high, uint8 (COLOUR_STEPS, 3)."""
    anchors = oklab(np.array(ANCHORS, dtype=np.uint8))
    lengths = np.linalg.norm(np.diff(anchors, axis=0), axis=1)
    along = np.append(0, np.cumsum(lengths))
    steps = np.linspace(0, along[-1], COLOUR_STEPS)
    lab = np.stack([np.interp(steps, along, channel) for channel in anchors.T], axis=1)
    scale = from_oklab(lab)
    scale.flags.writeable = False
    return scale


def height_range(surface: SurfaceMap) -> tuple[float, float]:
    """Return the heights that take the lowest and the highest colour.

    They are percentiles of the measured heights, or of all heights where none is measured; (0, 0)
    for a map without patches.
    """
    height = surface.height[surface.origin == MEASURED]
    if len(height) == 0:
        height = surface.height
    if len(height) == 0:
        return 0.0, 0.0
    low, high = np.percentile(height, HEIGHT_PERCENTILES)
    return float(low), float(high)


def height_colours(height: Float64, low: float, high: float) -> UInt8:
    """Return the colours of heights (N,), uint8 (N, 3); heights outside low to high take the ends.

    Where `low` equals `high`, heights equal to them take the middle of the scale.
    """
    position = (height - low) / (high - low) if high > low else (np.sign(height - low) + 1) / 2
    step = np.rint(np.clip(position, 0, 1) * (COLOUR_STEPS - 1)).astype(np.int64)
    colours: UInt8 = height_scale()[step]
    return colours


def patch_colours(height: Float64, origin: UInt8, low: float, high: float) -> UInt8:
    """Return colours by height, uint8 (N, 3): plastered lighter by half, artificial red.

    Parameters
    ----------
    height : float64 (N,)
        Heights of the patches or vertices to colour.
    origin : uint8 (N,)
        Origin of the patch at each height.
    low, high : float
        The heights of the lowest and the highest colour.
    """
    colours = height_colours(height, low, high)
    plastered = origin == PLASTERED
    colours[plastered] = (colours[plastered].astype(np.uint16) + WHITE) // 2
    colours[origin == ARTIFICIAL] = ARTIFICIAL_RED
    return colours


def origin_at(surface: SurfaceMap, patch: Int64, height: Float64) -> UInt8:
    """Return the origin of what patches show at some heights, uint8 (N,).

    What a stage has drawn out or moved beyond the points of a measured patch is closed, and shown
    as plastered.

    Parameters
    ----------
    surface : SurfaceMap
    patch : int64 (N,)
        Indices of patches.
    height : float64 (N,)
        A height of each.
    """
    origin = surface.origin[patch]
    slack = SNAP * surface.cell_size
    beyond = (height > surface.top[patch] + slack) | (height < surface.bottom[patch] - slack)
    origin[beyond & (surface.moved[patch] > 0)] = PLASTERED
    return origin


class Scale(NamedTuple):
    """The quantity that the colours of patches stand for.

    Attributes
    ----------
    label : str
        What the quantity is called.
    value : float64 (P,)
        Its value for each patch; NaN where a patch has none.
    low, high : float
        The values of the lowest and the highest colour.
    """

    label: str
    value: Float64
    low: float
    high: float


def scale_of(surface: SurfaceMap, by: ColourBy) -> Scale | None:
    """Return the scale of a map's colours; None for ``origin`` and ``region``, which have no scale.

    Variances and uncertainties are given as standard deviations, counts as their logarithms to base
    10, times in seconds since the earliest; where no time is known, the numbers of keyframes stand
    for times.
    """
    if by == "height":
        return Scale("height", surface.height, *height_range(surface))
    if by in ("origin", "region"):
        return None
    label, value = _amounts(surface, by)
    known = value[np.isfinite(value)]
    if len(known) == 0:
        return Scale(label, value, 0.0, 0.0)
    low, high = np.percentile(known, HEIGHT_PERCENTILES)
    return Scale(label, value, float(low), float(high))


def _amounts(surface: SurfaceMap, by: ColourBy) -> tuple[str, Float64]:
    """Return the label and the values, float64 (P,), of a quantity; NaN for inserted patches."""
    if by == "variance":
        return "standard deviation of heights", np.sqrt(surface.variance)
    if by == "uncertainty":
        return "standard deviation of the height's error", np.sqrt(surface.height_variance)
    if by == "count":
        points = np.where(surface.count > 0, surface.count, np.nan)
        return "points, as powers of 10", np.log10(points)
    return _times(surface)


def _times(surface: SurfaceMap) -> tuple[str, Float64]:
    """Return the label and the values, float64 (P,), of when patches were first measured."""
    row = surface.first_keyframe
    if len(surface.route) == 0:
        return "keyframe", np.full(surface.size, np.nan)
    stamp = surface.route[:, 0]
    label = "time of first measurement (s)"
    if np.isfinite(stamp).any():
        stamp = stamp - np.nanmin(np.where(np.isfinite(stamp), stamp, np.nan))
    else:
        label, stamp = "first keyframe", np.arange(len(stamp), dtype=np.float64)
    return label, np.where(row >= 0, stamp[np.maximum(row, 0)], np.nan)


class Paint:
    """Colours patches and vertices of a map.

    Parameters
    ----------
    surface : SurfaceMap
        The whole map: patches that a mesh leaves out count for the scale as well.
    by : str
        What the colours stand for, one of `COLOURS`.
    """

    def __init__(self, surface: SurfaceMap, by: ColourBy) -> None:
        self.by = by
        self.scale = scale_of(surface, by)

    def __call__(self, surface: SurfaceMap, patch: Int64, height: Float64) -> UInt8:
        """Return the colours of patches or vertices, uint8 (N, 3).

        Parameters
        ----------
        surface : SurfaceMap
            The map, or a part of it.
        patch : int64 (N,)
            The patch in `surface` that each of them is or belongs to.
        height : float64 (N,)
            Their heights: what lies beyond the points of its patch has the colour of a plastered
            one.
        """
        origin = origin_at(surface, patch, height)
        if self.by == "region":
            return region_colours(surface.region[patch])
        if self.scale is None:
            colours: UInt8 = origin_colours()[origin]
            return colours
        if self.by == "height":
            return patch_colours(height, origin, self.scale.low, self.scale.high)
        value = _amounts(surface, self.by)[1][patch]
        known = np.isfinite(value) & (origin == MEASURED)
        colours = np.tile(np.array(PALE, dtype=np.uint8), (len(patch), 1))
        colours[known] = height_colours(value[known], self.scale.low, self.scale.high)
        colours[origin == ARTIFICIAL] = ARTIFICIAL_RED
        return colours


def origin_colours() -> UInt8:
    """Return the colours of measured, plastered and artificial patches, uint8 (3, 3)."""
    measured = height_scale()[COLOUR_STEPS // 2].astype(np.uint16)
    return np.array([measured, (measured + WHITE) // 2, ARTIFICIAL_RED], dtype=np.uint8)


def region_colours(region: Int32) -> UInt8:
    """Return the colours of regions (N,), uint8 (N, 3): successive numbers far apart in hue."""
    hue = region * (np.pi * (3 - np.sqrt(5)))
    lightness = np.where(region % 2 == 0, 0.78, 0.6)
    colours = from_oklab(np.column_stack((lightness, 0.11 * np.cos(hue), 0.11 * np.sin(hue))))
    colours[region < 0] = PALE
    return colours
