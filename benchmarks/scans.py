"""Dense scans of real places, and sparse, noisy samples of them: drawn at random, or of flights.

The scans lie in ../shared/data beside the checkout, for whoever has them.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from mlscli.io.reading.recording import open_recording
from mlscli.keyframes.batches import gather
from mlscli.keyframes.keyframe import Keyframe
from mlscli.runtime.arrays import Float64, Int64
from mlscli.scenes import scans as scenes
from mlscli.scenes.noise import Chances, Noise, are_wrong, displace
from mlscli.scenes.scan_flight import fly_scan
from mlscli.scenes.surfaces import Scatter

DATA = Path(__file__).resolve().parent.parent.parent / "shared" / "data"

# Of the heights' errors, in cells; sideways a third of it.
SIGMA = 0.25
SIDEWAYS = 1 / 3
# So many points have errors in height so many times as great; and so many any height at all.
COARSE, TIMES = 0.1, 5
GROSS = 0.05

# How many points a keyframe of a flight finds at most.
FEATURES = (500, 100)


class Scan(NamedTuple):
    """A dense scan.

    Attributes
    ----------
    files : tuple of str
        Its files, taken as one.
    up : str
        Which axis points up.
    sizes : tuple of int
        How many points are drawn at random.
    """

    files: tuple[str, ...]
    up: str
    sizes: tuple[int, ...]

    def points(self, data: Path) -> Float64:
        """Return the points of the scan, z up, float64 (N, 3)."""
        return read(*(data / "multilevel" / name for name in self.files), up=self.up)


SCANS = {
    "building": Scan(("building_floors_cgal.ply",), "z", (20_000, 5_000)),
    "footbridge": Scan(("footbridge_yup_dddmr_map.pcd",), "y", (12_000, 4_000)),
    "als_bridge": Scan(("als_bridge_samp21.pcd",), "z", (4_000, 1_500)),
    "als_underpass": Scan(("als_underpass_samp22.pcd",), "z", (8_000, 2_500)),
    # The second scan is registered to the frame of the first: from two places more of the office is
    # seen, so that less of a map is called wrong for want of a view.
    "office": Scan(
        ("unitree_ISR_scan_01_raw.xyz", "unitree_ISR_scan_02_registered.xyz"), "z", (5_000, 2_000)
    ),
}

# Airborne scans, and the file with their points on the ground.
GROUND = {
    "als_bridge": "als_bridge_samp21_ground.pcd",
    "als_underpass": "als_underpass_samp22_ground.pcd",
}


def read(*files: Path, up: str = "z") -> Float64:
    """Return the points of files, float64 (N, 3), turned so that an axis of them points up."""
    return gather(open_recording(*files, up=up)).points.xyz


class Sample(NamedTuple):
    """Points of a scan, without and with noise.

    Attributes
    ----------
    clean, noisy : float64 (N, 3)
        The points as they are, and as they are given to the programs.
    evidence : float64 (M, 3)
        What can be known from the noisy points: those that are not grossly wrong, without errors.
    cell : float
        The cell of the clean points, see `cell_of`: the unit of the noise.
    keyframes : list of Keyframe
        The noisy points by keyframe, with the craft's positions if it was a flight.
    """

    clean: Float64
    noisy: Float64
    evidence: Float64
    cell: float
    keyframes: list[Keyframe]


def cell_of(points: Float64) -> float:
    """Return the size of cells that suits points: twice the usual distance to the fourth neighbour.

    So does `cell_size: auto` today, but a distance to score maps at must not change with it.
    """
    from scipy.spatial import cKDTree

    distances, _ = cKDTree(points).query(points, k=[5])
    return float(f"{2 * np.median(distances):.1e}")


def drawn(scan: Float64, size: int, seed: int) -> Sample:
    """Draw points of a scan at random, none twice, and add noise; see `_scattered`."""
    rng = np.random.default_rng(seed)
    clean = scan[rng.choice(len(scan), size, replace=False)]
    cell = cell_of(clean)
    noisy, evidence = _scattered(clean, cell, _heights(scan), rng)
    return Sample(clean, noisy, evidence, cell, [Keyframe(noisy)])


def _heights(scan: Float64) -> tuple[float, float]:
    """Return the least and the greatest height."""
    return float(scan[:, 2].min()), float(scan[:, 2].max())


def _scattered(
    clean: Float64, cell: float, heights: tuple[float, float], rng: np.random.Generator
) -> tuple[Float64, Float64]:
    """Return points with noise, and what can be known from them.

    Heights err by `SIGMA` cells, x and y by a third of that; `COARSE` of the points by `TIMES` as
    much in height, and `GROSS` of them have any height from the first to the last of `heights`.
    """
    size, sigma = len(clean), SIGMA * cell
    noisy = clean + rng.normal(0, 1, (size, 3)) * (SIDEWAYS * sigma, SIDEWAYS * sigma, sigma)
    coarse = rng.permutation(size)[: round(COARSE * size)]
    noisy[coarse, 2] = clean[coarse, 2] + rng.normal(0, TIMES * sigma, len(coarse))
    gross = _spread(noisy, heights, rng)
    # That a point was moved sideways, maybe into another cell, cannot be known.
    return noisy, np.delete(np.column_stack((noisy[:, :2], clean[:, 2])), gross, axis=0)


def _spread(noisy: Float64, heights: tuple[float, float], rng: np.random.Generator) -> Int64:
    """Give `GROSS` of the points any height, in place, and return their numbers."""
    gross = rng.permutation(len(noisy))[: round(GROSS * len(noisy))]
    noisy[gross, 2] = rng.uniform(*heights, len(gross))
    return gross


def flown(scan: Float64, features: int, seed: int) -> tuple[Sample, Sample]:
    """Fly over a scan, as `mls synth --cloud` does, and add noise.

    Parameters
    ----------
    scan : float64 (N, 3)
    features : int
        How many points a keyframe finds at most.
    seed : int

    Returns
    -------
    thesis, slam : Sample
        The same points with the noise of `drawn`; and with that of triangulation, which grows with
        the distance: at the median distance it is as great, and of `COARSE` of the points the
        depth is half to twice the true one.
    """
    surfaces = scenes.Scan.of("scan", scan)
    exact = Noise(sigma=Scatter(0.0, 0.0), salt_pepper=0.0)
    flight = fly_scan(surfaces, features, exact, seed=seed)
    sizes = [len(keyframe.points) for keyframe in flight.keyframes]
    clean = gather(flight.keyframes).points.xyz
    cell, heights, rng = cell_of(clean), _heights(scan), np.random.default_rng(seed)
    noisy, evidence = _scattered(clean, cell, heights, rng)
    cameras = np.repeat([keyframe.position for keyframe in flight.keyframes], sizes, axis=0)
    sigma = np.full((len(clean), 2), SIGMA * cell) * (SIDEWAYS, 1.0)
    slam, chances = Noise("slam", salt_pepper=COARSE, reference=flight.range), Chances(seed)
    seen = displace(clean, cameras, sigma, slam, chances)
    right = ~are_wrong(len(clean), slam, chances)
    right[_spread(seen, heights, rng)] = False

    def keyframes(points: Float64) -> list[Keyframe]:
        parts = np.split(points, np.cumsum(sizes)[:-1])
        return [
            Keyframe(part, keyframe.stamp, keyframe.position)
            for part, keyframe in zip(parts, flight.keyframes, strict=True)
        ]

    return (
        Sample(clean, noisy, evidence, cell, keyframes(noisy)),
        Sample(clean, seen, clean[right], cell, keyframes(seen)),
    )
