"""What the patches of a map can be coloured by, and what the colours mean."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlscli.maps.surface_map import SurfaceMap
from mlscli.mesh.colours import ARTIFICIAL_RED, COLOURS, PALE, ColourBy, Paint, origin_colours
from mlscli.runtime.arrays import UInt8

Colour = tuple[int, int, int]

_WIDER = (ARTIFICIAL_RED, "artificial: inserted in a wider gap")


class Colouring(NamedTuple):
    """The colours of all patches, and a legend.

    Attributes
    ----------
    name : str
        What the colours stand for, one of `mlscli.mesh.colours.COLOURS`.
    label : str
        What the scale shows; where there is no scale, what the colours show.
    ends : tuple of float, optional
        The values of the lowest and the highest colour of the scale; None: there is no scale.
    kinds : list of (tuple of int, str)
        Colours (red, green, blue) that are not on the scale, and what they stand for.
    colour : uint8 (P, 3)
        Red, green, blue of each patch.
    """

    name: ColourBy
    label: str
    ends: tuple[float, float] | None
    kinds: list[tuple[Colour, str]]
    colour: UInt8


def colourings(surface: SurfaceMap) -> list[Colouring]:
    """Return the ways to colour a map, ``height`` first.

    ``region`` is left out where no patch has one, ``uncertainty`` where that of no height is known,
    ``time`` where there are fewer than two keyframes.
    """
    missing = set()
    if not (surface.region >= 0).any():
        missing.add("region")
    if np.isnan(surface.noise).all():
        missing.add("uncertainty")
    if len(surface.route) < 2:
        missing.add("time")
    return [_colouring(surface, by) for by in COLOURS if by not in missing]


def _colouring(surface: SurfaceMap, by: ColourBy) -> Colouring:
    paint = Paint(surface, by)
    # The upper end of what was measured of a wall stands for the wall.
    drawn = (surface.moved > 0) & (surface.depth > 0)
    height = np.where(drawn, np.minimum(surface.height, surface.top), surface.height)
    colour = paint(surface, np.arange(surface.size), height)
    if paint.scale is None:
        label = "origin" if by == "origin" else "each region has a colour"
        return Colouring(by, label, None, _kinds(by), colour)
    label, ends = paint.scale.label, (paint.scale.low, paint.scale.high)
    if by == "count":
        # The scale is logarithmic; its ends are given as numbers of points.
        label, ends = "points, logarithmic", (10 ** ends[0], 10 ** ends[1])
    return Colouring(by, label, ends, _kinds(by), colour)


def _kinds(by: ColourBy) -> list[tuple[Colour, str]]:
    """Return the colours that are not on the scale, and what they stand for."""
    measured, plastered, _ = (_colour(row) for row in origin_colours())
    if by == "region":
        return [(PALE, "of no region")]
    if by == "origin":
        return [
            (measured, "measured"),
            (plastered, "plastered: in a gap that the craft cannot pass"),
            _WIDER,
        ]
    if by == "height":
        return [(plastered, "lighter: in a gap that the craft cannot pass"), _WIDER]
    unknown = "plastered, or not known" if by == "uncertainty" else "plastered: nobody measured it"
    return [(PALE, unknown), _WIDER]


def _colour(row: UInt8) -> Colour:
    red, green, blue = row.tolist()
    return red, green, blue
