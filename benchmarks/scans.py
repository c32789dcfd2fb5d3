"""Dense scans of real places, and sparse, noisy samples of them as a flight might yield.

The scans lie in ../shared/data beside the checkout, for whoever has them.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from mlscli.io.reading.recording import open_recording
from mlscli.runtime.arrays import Float64

DATA = Path(__file__).resolve().parent.parent.parent / "shared" / "data"

# Of the heights' errors, in cells; sideways a third of it.
SIGMA = 0.25
SIDEWAYS = 1 / 3
# So many points have errors in height so many times as great; and so many any height at all.
COARSE, TIMES = 0.1, 5
GROSS = 0.05


class Scan(NamedTuple):
    """A dense scan.

    Attributes
    ----------
    files : tuple of str
        Its files, taken as one.
    up : str
        Which axis points up.
    sizes : tuple of int
        How many points are drawn.
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
    recording = open_recording(*files, up=up)
    return np.concatenate([keyframe.points for keyframe in recording.keyframes()])


class Sample(NamedTuple):
    """Points drawn from a scan, without and with noise.

    Attributes
    ----------
    clean, noisy : float64 (N, 3)
        The points as drawn, and what is given to the programs.
    evidence : float64 (M, 3)
        The noisy points but those whose height is any, at their true heights: what can be known.
    cell : float
        The cell of the clean points, see `cell_of`: the unit of the noise.
    """

    clean: Float64
    noisy: Float64
    evidence: Float64
    cell: float


def cell_of(points: Float64) -> float:
    """Return the size of cells that suits points: twice the usual distance to the fourth neighbour.

    So does `cell_size: auto` today, but a distance to score maps at must not change with it.
    """
    from scipy.spatial import cKDTree

    distances, _ = cKDTree(points).query(points, k=[5])
    return float(f"{2 * np.median(distances):.1e}")


def draw(scan: Float64, size: int, seed: int) -> Sample:
    """Draw points of a scan at random, none twice, and add noise.

    Heights err by `SIGMA` cells, x and y by a third of that; `COARSE` of the points by `TIMES` as
    much in height, and `GROSS` of them have any height of the scan's.
    """
    rng = np.random.default_rng(seed)
    clean = scan[rng.choice(len(scan), size, replace=False)]
    cell = cell_of(clean)
    sigma = SIGMA * cell
    noisy = clean + rng.normal(0, 1, (size, 3)) * (SIDEWAYS * sigma, SIDEWAYS * sigma, sigma)
    coarse = rng.permutation(size)[: round(COARSE * size)]
    noisy[coarse, 2] = clean[coarse, 2] + rng.normal(0, TIMES * sigma, len(coarse))
    gross = rng.permutation(size)[: round(GROSS * size)]
    noisy[gross, 2] = rng.uniform(scan[:, 2].min(), scan[:, 2].max(), len(gross))
    evidence = np.delete(np.column_stack((noisy[:, :2], clean[:, 2])), gross, axis=0)
    return Sample(clean, noisy, evidence, cell)
