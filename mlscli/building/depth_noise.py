"""`rays.noise: auto`: how the depths of a recording err, found from the recording itself.

Seen from one place, the inverse depth of a plane is linear in the direction. So a point whose
inverse depth differs from the linear fit to the points in the directions around it shows how much
inverse depths err, wherever its own depth has come to lie. Errors of triangulation are alike in
inverse depth: their standard deviation is that of a depth of 1.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from mlscli.geometry.surroundings import chosen
from mlscli.keyframes.batches import FARTHEST
from mlscli.keyframes.keyframe import Keyframe
from mlscli.pipeline.report import Report
from mlscli.runtime.arrays import Float64

# Keyframes are taken together until they have so many points, as long as the craft is no farther
# from where it was than this share of the depth in the middle.
_TOGETHER, _APART = 64, 0.2
# Of more points, so many are looked at, and so many are asked.
_MOST_POINTS, _MOST_ASKED = 4096, 128
# Directions around one, and how many of them the fit follows: wrong correspondences are left out.
_AROUND, _FOLLOWED, _FITS = 12, 9, 4
# The quartile of the absolute values of a standard normal distribution: moved little by the edges
# of surfaces and by wrong correspondences.
_QUARTILE = 0.3186394
# So many depths tell how they err; their errors grow at least with this power of the depth, from
# depths to others so many times as great.
_ENOUGH, _LEAST_POWER, _LEAST_SPREAD = 300, 0.9, 1.5
_PARTS = 10


class DepthNoise:
    """Keyframes, as they come, and what they tell about errors of depth."""

    def __init__(self) -> None:
        self._waiting: list[Keyframe] = []
        self._size = 0
        self._found: list[Float64] = []

    def add(self, keyframe: Keyframe) -> None:
        """Take the next keyframe; only those with points and a position tell anything."""
        inside = (np.abs(keyframe.points - keyframe.position) <= FARTHEST).all(axis=1)
        if not inside.any():
            return
        keyframe = replace(keyframe, points=keyframe.points[inside])
        if self._waiting and not self._is_near(keyframe):
            self._look()
        self._waiting.append(keyframe)
        self._size += len(keyframe.points)
        if self._size >= _TOGETHER:
            self._look()

    @property
    def value(self) -> float:
        """The standard deviation of a depth of 1, in the unit of the recording, to two digits.

        It is 0 where errors are not seen to grow with the depth, as those of triangulation do.
        """
        if self._waiting:
            self._look()
        found = np.concatenate([np.empty((0, 2)), *self._found])
        if len(found) < _ENOUGH:
            return 0.0
        error, depth = found[np.argsort(found[:, 1], kind="stable")].T
        parts = np.array_split(np.arange(len(depth)), _PARTS)
        places = np.log([np.median(depth[part]) for part in parts])
        errors = [np.quantile(error[part] * depth[part] ** 2, 0.25) for part in parts]
        if places[-1] - places[0] < np.log(_LEAST_SPREAD) or not min(errors) > 0.0:
            return 0.0
        if np.polyfit(places, np.log(errors), 1)[0] < _LEAST_POWER:
            return 0.0
        return float(f"{np.quantile(error, 0.25) / _QUARTILE:.1e}")

    def _is_near(self, keyframe: Keyframe) -> bool:
        first = self._waiting[0]
        depth = np.median(np.linalg.norm(first.points - first.position, axis=1))
        moved = np.subtract(keyframe.position, first.position)
        return bool(np.linalg.norm(moved) <= _APART * depth)

    def _look(self) -> None:
        """Note the errors and depths of the waiting keyframes' points, as seen from the first."""
        points = np.concatenate([keyframe.points for keyframe in self._waiting])
        rays = chosen(points, _MOST_POINTS) - self._waiting[0].position
        self._waiting, self._size = [], 0
        depth = np.linalg.norm(rays, axis=1)
        rays, depth = rays[depth > 0.0], depth[depth > 0.0]
        if len(depth) > _AROUND:
            self._found.append(np.column_stack(_errors(rays / depth[:, None], depth)))


def auto_noise(keyframes: Iterable[Keyframe]) -> float:
    """Return the standard deviation of a depth of 1, which grows with the square of the depth.

    Parameters
    ----------
    keyframes : iterable of Keyframe
        All of a recording, in their order.

    Returns
    -------
    float
        As `DepthNoise.value`.
    """
    noise = DepthNoise()
    for keyframe in keyframes:
        noise.add(keyframe)
    return noise.value


def told(noise: float, report: Report) -> float:
    """Return the noise that was found, and tell the report if there is any."""
    if noise:
        report.sizes["noise"] = f"auto: a depth errs by {noise:g} times its square"
    return noise


def _errors(ahead: Float64, depth: Float64) -> tuple[Float64, Float64]:
    """Return how far inverse depths are from those in the directions around, and the depths.

    Parameters
    ----------
    ahead : float64 (N, 3)
        Directions, as unit vectors.
    depth : float64 (N,)

    Returns
    -------
    errors, depths : float64 (M,)
        Of some of the points.
    """
    from scipy.spatial import cKDTree

    asked = np.arange(0, len(ahead), max(1, len(ahead) // _MOST_ASKED))[:_MOST_ASKED]
    nearest = cKDTree(ahead).query(ahead[asked], k=_AROUND + 1)[1][:, 1:]
    # Two axes across each direction.
    level = np.column_stack((-ahead[asked, 1], ahead[asked, 0], np.zeros(len(asked))))
    flat = np.linalg.norm(level, axis=1)
    level[flat == 0.0], flat[flat == 0.0] = (1.0, 0.0, 0.0), 1.0
    level /= flat[:, None]
    across = np.cross(ahead[asked], level)
    places = np.stack(
        [
            np.ones(nearest.shape),
            np.einsum("nki,ni->nk", ahead[nearest], level),
            np.einsum("nki,ni->nk", ahead[nearest], across),
        ],
        axis=2,
    )
    inverse = 1.0 / depth[nearest]
    weight = np.ones(nearest.shape)
    for _ in range(_FITS):
        fit = _linear(places, inverse, weight)
        off = np.abs(np.einsum("nkp,np->nk", places, fit) - inverse)
        weight = (np.argsort(np.argsort(off, axis=1), axis=1) < _FOLLOWED).astype(np.float64)
    return np.abs(1.0 / depth[asked] - fit[:, 0]), depth[asked]


def _linear(places: Float64, values: Float64, weight: Float64) -> Float64:
    """Return weighted linear fits, float64 (N, P), to values (N, K) at places (N, K, P)."""
    weighted = places * weight[:, :, None]
    normal = np.einsum("nkp,nkq->npq", weighted, places)
    # Where the places lie on a line, the fit is level across it.
    spread = np.einsum("npp->n", normal[:, 1:, 1:])
    normal[:, 1:, 1:] += (1e-3 * spread + 1e-300)[:, None, None] * np.eye(places.shape[2] - 1)
    right = np.einsum("nkp,nk->np", weighted, values)
    solved: Float64 = np.linalg.solve(normal, right[:, :, None])[:, :, 0]
    return solved
