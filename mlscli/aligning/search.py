"""Search of how a map lies in the frame of another, without a first guess.

For each yaw and each scale, the evidence of all shifts is one correlation, by FFT: of the first
map's field with the voxels of the second. The best of all are climbed from, by the method of
J. A. Nelder and R. Mead (The Computer Journal 7, 1965), in voxels that become finer.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy import fft
from scipy.optimize import minimize

from mlscli.aligning.evidence import Evidence, Field, fitting_width, indices_of, sides
from mlscli.geometry.similarity import Similarity
from mlscli.runtime.arrays import Float64

SCALES = 3.0
"""Scales are searched from a third to three times that at which both maps are equally wide."""

# Voxels across the smaller of the maps, in the first pass, and at most across the larger. Where no
# scale is searched there is time for finer ones: a room of 20 m is no more than two of 1.2 m high.
_ACROSS, _FINER_ACROSS, _MOST_ACROSS = 16, 48, 64
# Steps of yaw and scale, in voxels at the rim of the map.
_STEP = 0.8
_PEAKS = 3
_LISTED, _CLIMBED, _FINER = 600, 20, 6


class Found(NamedTuple):
    """A fit, and what speaks for it.

    Attributes
    ----------
    fit : Similarity
        From the frame of the second map to that of the first.
    evidence : float
        In nats, per voxel as wide as a cell of the first map.
    width : float
        Of the voxels in which it was found, in the unit of the first map.
    """

    fit: Similarity
    evidence: float
    width: float


@dataclass(frozen=True, eq=False)
class Pair:
    """Two maps as points on their surfaces.

    Attributes
    ----------
    one, other : float64 (N, 3)
        The points of `other` are relative to `pivot`.
    cell_sizes : tuple of float
    pivot : float64 (3,)
        The middle of the second map's points, in its frame.
    """

    one: Float64
    other: Float64
    cell_sizes: tuple[float, float]
    pivot: Float64

    @classmethod
    def of(cls, one: Float64, other: Float64, cell_sizes: tuple[float, float]) -> Pair:
        """Return the pair of two maps' points, each in its frame."""
        pivot = other.mean(axis=0)
        return cls(one, other - pivot, cell_sizes, pivot)

    @cached_property
    def radius(self) -> float:
        """How far the points of the second map lie from its pivot, sideways: root mean square."""
        return _radius(self.other)

    def width(self, scale: float) -> float:
        """Return the wider of the cells of both, in the unit of the first, or what fits."""
        width = max(self.cell_sizes[0], scale * self.cell_sizes[1])
        width = fitting_width(self.one, width)
        return fitting_width(self.other, width / scale) * scale

    def apart(self, one: Similarity, other: Similarity) -> float:
        """Return how far two fits take the rim of the second map apart, at most."""
        rim = self.radius * np.array([[1, 1, 0], [1, -1, 0], [-1, 1, 0], [-1, -1, 0]])
        return float(np.abs(one.points(rim) - other.points(rim)).max())


def search(pair: Pair, scale: float | None) -> list[Found]:
    """Return fits that differ, the best first.

    Parameters
    ----------
    pair : Pair
    scale : float or None
        The scale, where it is known.
    """
    usual = _radius(pair.one) / pair.radius if scale is None else scale
    wide = [float(np.ptp(points[:, :2], axis=0).max()) for points in (pair.one, pair.other)]
    smaller, larger = sorted((wide[0], wide[1] * usual))
    across = _ACROSS if scale is None else _FINER_ACROSS
    width = max(smaller / across, larger / _MOST_ACROSS, pair.cell_sizes[0])
    step = _STEP * width / (max(smaller, width) / 2)
    scales = [usual]
    if scale is None:
        most = math.ceil(math.log(SCALES) / step)
        scales = [usual * math.exp(step * n) for n in range(-most, most + 1)]
    yaws = np.linspace(0, 2 * math.pi, math.ceil(2 * math.pi / step), endpoint=False).tolist()
    coarse: list[Found] = []
    for each in scales:
        # The more a map outgrows the first, the wider the voxels: there would be too many.
        coarse += _correlated(pair, width * max(1.0, each / usual), each, yaws)
    coarse.sort(key=lambda found: -found.evidence)
    climbed = [
        _climbed(pair, found.fit, found.width, scale is None)
        for found in _distinct(pair, coarse[:_LISTED], 2.5)[:_CLIMBED]
    ]
    finer = [
        _climbed(pair, found.fit, pair.width(found.fit.scale), scale is None)
        for found in _distinct(pair, climbed, 1.0)[:_FINER]
    ]
    return _distinct(pair, finer, 3.0)


def _radius(points: Float64) -> float:
    middle = points[:, :2] - points[:, :2].mean(axis=0)
    return float(np.sqrt((middle**2).sum(axis=1).mean()))


def _distinct(pair: Pair, found: Sequence[Found], voxels: float) -> list[Found]:
    """Return the best of fits that differ by less than so many voxels, the best first."""
    kept: list[Found] = []
    for each in sorted(found, key=lambda found: -found.evidence):
        if all(pair.apart(each.fit, one.fit) > voxels * max(each.width, one.width) for one in kept):
            kept.append(each)
    return kept


def _correlated(pair: Pair, width: float, scale: float, yaws: Sequence[float]) -> Iterator[Found]:
    """Yield the best shifts for each yaw, in voxels of this width, or as wide as memory needs."""
    room = np.ptp(pair.other, axis=0)
    room[:2] = np.hypot(*room[:2])
    both = np.vstack((np.zeros(3), np.ptp(pair.one, axis=0) + room * scale))
    width = fitting_width(both, width)
    field = Field.of(pair.one, width)
    first = np.array(field.evidence.shape)
    needed = first + np.ceil(room * scale / sides(width)).astype(int) + 2
    shape = [fft.next_fast_len(int(n), real=True) for n in needed]
    # The lowest and highest voxels go on below and above.
    evidence = np.zeros(shape, dtype=np.float32)
    evidence[: first[0], : first[1]] = field.evidence[:, :, :1]
    evidence[: first[0], : first[1], : first[2]] = field.evidence
    spectrum = fft.rfftn(evidence)
    per_cell = (width / pair.cell_sizes[0]) ** 2
    for yaw in yaws:
        voxels = indices_of(Similarity(yaw, scale).points(pair.other), width)
        least = voxels.min(axis=0)
        occupied = np.zeros(shape, dtype=np.float32)
        occupied[tuple((voxels - least).T)] = 1
        total = fft.irfftn(spectrum * np.conj(fft.rfftn(occupied)), s=shape)
        for _ in range(_PEAKS):
            place = np.unravel_index(int(np.argmax(total)), shape)
            value = float(total[place]) * per_cell
            shift = np.where(np.array(place) >= first, np.array(place) - shape, place)
            x, y, z = ((shift + field.least - least) * sides(width)).tolist()
            yield Found(Similarity(yaw, scale, (x, y, z)), value, width)
            around = [np.arange(i - 2, i + 3) % n for i, n in zip(place, shape, strict=True)]
            total[np.ix_(*around)] = -np.inf


def _climbed(pair: Pair, start: Similarity, width: float, scaled: bool) -> Found:
    """Return the fit to which the evidence leads from another, in voxels of this width."""
    evidence = Evidence.of(pair.one, pair.other, width, start.scale)
    turn = width / (pair.radius * start.scale)
    units = np.array([turn, width, width, width / 2] + [turn] * scaled)

    def fit_of(steps: Float64) -> Similarity:
        yaw, x, y, z, *scale = (steps * units).tolist()
        shift = (start.shift[0] + x, start.shift[1] + y, start.shift[2] + z)
        return Similarity(start.yaw + yaw, start.scale * math.exp(sum(scale)), shift)

    simplex = np.vstack((np.zeros(len(units)), np.eye(len(units)) * 0.7))
    options = {"initial_simplex": simplex, "maxfev": 80, "xatol": 0.02, "fatol": 0.02}
    best = minimize(
        lambda steps: -evidence.total(fit_of(steps)),
        simplex[0],
        method="Nelder-Mead",
        options=options,
    )
    per_cell = (width / pair.cell_sizes[0]) ** 2
    return Found(fit_of(best.x), -float(best.fun) * per_cell, width)
