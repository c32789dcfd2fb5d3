"""How thick the surfaces of a cloud are, and how many of them stand upright.

Each is seen in the surroundings of some points: a principal axis along which they spread least is
the normal of a surface (H. Hoppe et al., 1992, https://doi.org/10.1145/133994.134011), and how far
they spread along it is the surface's roughness and the noise of the points together.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from mlscli.geometry.spacing import Neighbourhoods
from mlscli.runtime.arrays import Bool, Float64, Int64
from mlscli.runtime.threads import in_ranges

ASKED = 2000
"""How many points are asked."""

# For so many neighbours; of fewer than the last nothing is told.
_MOST, _FEWEST = 64, 8
# Surroundings are flat where they spread across by less than this share of the shorter side.
_FLAT = 0.5
# They lie on a curve, such as a beam's on a wall, where that side is as much shorter than the
# longer one: then noise is what spreads along it.
_CURVE = 0.25
# A surface is upright where its normal rises by less than this, some 17 degrees.
_UPRIGHT = 0.3
# Noise is that of the flattest quarter: elsewhere surfaces bend, meet, or are leaves.
_FLATTEST = 0.25
# From a median distance to a standard deviation (P. Rousseeuw and C. Croux, 1993,
# https://doi.org/10.1080/01621459.1993.10476408).
_DEVIATION = 1.4826


class Roughness(NamedTuple):
    """What the surroundings of points tell.

    Attributes
    ----------
    noise : float
        Standard deviation across the flattest surfaces, in the unit of the recording; 0 where no
        point has enough neighbours.
    asked : int
        How many of the points have enough neighbours, and these not along a curve.
    flat : float
        The share of these whose neighbours lie on a surface; 0 where there are none.
    upright : float
        The share of these that stand upright; 0 where there are none.
    """

    noise: float
    asked: int
    flat: float
    upright: float


def roughness(cloud: Neighbourhoods, reach: float) -> Roughness:
    """Return how thick surfaces are, and how many stand upright.

    Parameters
    ----------
    cloud : Neighbourhoods
    reach : float
        How far surroundings extend, in the unit of the recording.
    """
    return roughness_around([(cloud.points[cloud.some(ASKED)], cloud)], reach)


def roughness_around(parts: Iterable[tuple[Float64, Neighbourhoods]], reach: float) -> Roughness:
    """Return the same of a cloud in parts.

    Parameters
    ----------
    parts : iterable of (float64 (N, 3), Neighbourhoods)
        The points that are asked, and a cloud with all points within `reach` of them.
    reach : float
        How far surroundings extend, in the unit of the recording.
    """
    found = [each for asked, cloud in parts for each in _of_part(asked, cloud, reach)]
    if not found:
        return Roughness(0.0, 0, 0.0, 0.0)
    thickness, curved, flat, upright = (np.concatenate(each) for each in zip(*found, strict=True))
    noise = float(np.quantile(thickness, _FLATTEST)) if len(thickness) else 0.0
    enough, surfaces = (int(np.count_nonzero(each)) for each in (~curved, flat))
    stand = int(np.count_nonzero(upright))
    return Roughness(noise, enough, surfaces / max(enough, 1), stand / max(surfaces, 1))


_Fitted = tuple[Float64, Bool, Bool, Bool]


def _of_part(asked: Float64, cloud: Neighbourhoods, reach: float) -> list[_Fitted]:
    return in_ranges(
        len(asked),
        lambda begin, end: _fitted(*cloud.around(asked[begin:end], _MOST, reach)),
        weight=_MOST,
    )


def _fitted(near: Float64, there: Bool) -> _Fitted:
    """Return how thick surroundings are, and whether on a curve, a surface, an upright one.

    Parameters
    ----------
    near : float64 (N, K, 3)
        The surroundings of N points; those with few are left out.
    there : bool (N, K)
        Which of them there are.
    """
    enough = there.sum(axis=1) >= _FEWEST
    near, there = near[enough], there[enough]
    count = there.sum(axis=1)
    # Measured from the point itself, which is the nearest: coordinates may be large.
    offsets = np.where(there[..., None], near - near[:, :1], 0.0)
    offsets -= offsets.sum(axis=1, keepdims=True) / count[:, None, None]
    offsets[~there] = 0.0
    squares, axes = np.linalg.eigh(
        np.einsum("nki,nkj->nij", offsets, offsets) / count[:, None, None]
    )
    across, shorter, longer = np.sqrt(np.maximum(squares, 0.0)).T
    curved = shorter < _CURVE * longer
    flat = ~curved & (across < _FLAT * shorter)
    upright = flat & (np.abs(axes[:, 2, 0]) < _UPRIGHT)
    normals = np.where(curved[:, None], axes[..., 1], axes[..., 0])
    heights = np.where(there, np.einsum("nki,ni->nk", offsets, normals), np.nan)
    apart = np.abs(heights - _medians(heights, count)[:, None])
    return _DEVIATION * _medians(apart, count), curved, flat, upright


def _medians(values: Float64, count: Int64) -> Float64:
    """Return the medians of rows (N, K) of which so many, (N,), are there; the others are NaN.

    In a tenth of the time that nanmedian takes.
    """
    # NaN comes last.
    ordered, rows = np.sort(values, axis=1), np.arange(len(values))
    middle: Float64 = (ordered[rows, (count - 1) // 2] + ordered[rows, count // 2]) / 2
    return middle
