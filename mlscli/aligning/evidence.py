"""What a map says of where another lies: evidence, in nats, as a field in space.

Space is divided into voxels as wide as a cell and half as high. A voxel of the other map that comes
to lie where this one has a surface speaks for the fit, the more the rarer surfaces of that height
are: what floors say of floors is little. One that lies where this map has measured other heights
speaks against it. Where this map has measured nothing, it says nothing.

It is the logarithm of a ratio of likelihoods: of what is found if the fit is right, to what is
found if the maps have nothing to do with each other. The fields are those of likelihood-field
matching (S. Thrun, W. Burgard, D. Fox, *Probabilistic Robotics*, 2005, section 6.4), in 3D.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt, map_coordinates

from mlscli.geometry.similarity import Similarity
from mlscli.maps.surface_map import MEASURED, SurfaceMap
from mlscli.runtime.arrays import Array, Bool, Float32, Float64, Int64, UInt8

# Voxels lie off all surfaces so many times as often if a fit is right as if it is not: not never,
# as one flight sees the roof and another what is beneath.
_CONFLICT = 0.25
# How far off the nearest surface a voxel is still on it, as both are rounded to voxels; beyond, the
# sigma with which it says less. In voxels.
_ROUNDED, _SPREAD = 0.7, 0.6
# Surfaces of a height are never taken for rarer.
_RAREST = 0.02
_MARGIN = 3
# Of a field, and of points on walls.
_MOST_VOXELS, _MOST_POINTS = 2**22, 2**18


def samples_of(surface: SurfaceMap) -> Float64:
    """Return points on the measured patches, float64 (N, 3): on walls half a cell apart or less.

    Strays are left out, which lie farther from most patches than those span.
    """
    measured = _without_strays(surface.take(surface.origin == MEASURED))
    # Heights of a hostile map may span what no memory holds.
    step = max(measured.cell_size / 2, float(measured.depth.sum()) / _MOST_POINTS)
    pieces = np.ceil(measured.depth / step).astype(np.int64)
    patch = np.repeat(np.arange(measured.size), pieces + 1)
    number = np.arange(len(patch)) - np.repeat(np.cumsum(pieces + 1) - pieces - 1, pieces + 1)
    share = number / np.maximum(pieces, 1)[patch]
    middles = [(index[patch] + 0.5) * measured.cell_size for index in (measured.ix, measured.iy)]
    return np.column_stack((*middles, measured.height[patch] - share * measured.depth[patch]))


def _without_strays(measured: SurfaceMap) -> SurfaceMap:
    if not measured.size:
        return measured
    x, y = measured.ix * measured.cell_size, measured.iy * measured.cell_size
    bottoms = np.column_stack((x, y, measured.low_end))
    tops = np.column_stack((x, y, measured.height))
    low, high = np.quantile(bottoms, 0.01, axis=0), np.quantile(tops, 0.99, axis=0)
    room = float((high - low).max()) + 3 * measured.cell_size
    usual = (bottoms >= low - room) & (tops <= high + room)
    return measured.take(np.flatnonzero(usual.all(axis=1)))


@dataclass(frozen=True, eq=False)
class Field:
    """The evidence of a map, voxel by voxel.

    Attributes
    ----------
    width : float
        Of a voxel, in the unit of the map; it is half as high.
    least : int64 (3,)
        The indices of the first voxel.
    evidence : float32 (X, Y, Z)
        In nats; below and above, it is that of the lowest and highest voxels.
    near : uint8 (X, Y, Z)
        2 on surfaces and in the voxels next to them, 1 elsewhere; 0 beside the map.
    middles : float64 (V, 3)
        The mean of the points in each voxel that has some.
    """

    width: float
    least: Int64
    evidence: Float32
    near: UInt8
    middles: Float64

    @classmethod
    def of(cls, samples: Float64, width: float) -> Field:
        """Return the field of points on the surfaces of a map, in voxels of this width."""
        voxels = indices_of(samples, width)
        least = voxels.min(axis=0) - _MARGIN
        shape = tuple((voxels.max(axis=0) + _MARGIN + 1 - least).tolist())
        flat = np.ravel_multi_index(tuple((voxels - least).T), shape)
        held, of = np.unique(flat, return_inverse=True)
        sums = [np.bincount(of, samples[:, axis]) for axis in range(3)]
        middles = np.column_stack(sums) / np.bincount(of)[:, None]
        occupied = np.zeros(shape, dtype=np.bool_)
        occupied.flat[held] = True
        seen: Bool = np.asarray(occupied.any(axis=2))
        away = np.asarray(distance_transform_edt(~occupied), dtype=np.float64)
        match = np.exp(-0.5 * (np.maximum(away - _ROUNDED, 0) / _SPREAD) ** 2)
        usual = np.clip(match[seen].mean(axis=0), _RAREST, 1.0)
        gain, loss = np.log((1 - _CONFLICT * (1 - usual)) / usual), math.log(_CONFLICT)
        evidence = seen[:, :, None] * (loss + (gain - loss) * match)
        near: UInt8 = np.where(seen[:, :, None], np.where(away <= 1, 2, 1), 0).astype(np.uint8)
        return cls(width, least, evidence.astype(np.float32), near, middles)

    def at(self, points: Float64) -> Float64:
        """Return the evidence at points (N, 3), between voxels linearly; 0 beside the map."""
        return self._read(self.evidence, points, 1).astype(np.float64)

    def agreement(self, points: Float64) -> tuple[Bool, Bool]:
        """Return which points (N, 3) this map can judge, and which lie near its surfaces."""
        value = self._read(self.near, points, 0)
        return value > 0, value > 1

    def _read(self, array: Array, points: Float64, order: int) -> Array:
        """Return what an array of voxels holds at points, 0 beside the map."""
        place = points / sides(self.width) - self.least - 0.5
        place[:, 2] = np.clip(place[:, 2], 0, array.shape[2] - 1)
        found: Array = map_coordinates(
            array, place.T, order=order, mode="constant", cval=0.0, prefilter=False
        )
        return found


@dataclass(frozen=True, eq=False)
class Evidence:
    """What two maps say of how the second lies in the frame of the first.

    Attributes
    ----------
    one, other : Field
        The voxels of the second are as wide as those of the first, once they are scaled.
    """

    one: Field
    other: Field

    @classmethod
    def of(cls, samples: Float64, others: Float64, width: float, scale: float) -> Evidence:
        """Return it for points on both maps, and a scale that is about right."""
        return cls(Field.of(samples, width), Field.of(others, width / scale))

    def total(self, fit: Similarity) -> float:
        """Return what both say of a fit, in nats: what overlaps more says more."""
        forth = float(self.one.at(fit.points(self.other.middles)).sum())
        back = float(self.other.at(fit.inverse.points(self.one.middles)).sum())
        # The voxels of the other map are more or less numerous than those they come to lie in.
        return forth * (fit.scale * self.other.width / self.one.width) ** 2 + back


def indices_of(points: Float64, width: float) -> Int64:
    """Return the voxel in which each point lies, int64 (N, 3)."""
    return np.floor(points / sides(width)).astype(np.int64)


def fitting_width(samples: Float64, width: float) -> float:
    """Return a width of voxels, at least `width`, at which a field of the points fits in memory."""
    extent = np.ptp(samples, axis=0)
    while np.prod(extent / sides(width) + 2 * _MARGIN + 2) > _MOST_VOXELS:
        width *= 1.25
    return width


def sides(width: float) -> Float64:
    """Return the sides of a voxel along x, y and z."""
    return np.array([width, width, width / 2])
