"""How often `rays.noise: auto` finds noise that grows with the depth, where it is and where not.

Run it as ``python -m benchmarks.depth_noise``; it takes some minutes. Flights over scenes, and at
one height over real scans, each with errors of triangulation and with errors that are the same
everywhere, in all directions or in some. The thresholds were chosen on seeds from 1 on; those here
begin at 101.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np

from benchmarks.scans import DATA, SCANS, cell_of
from mlscli.building.depth_noise import auto_noise
from mlscli.keyframes.keyframe import Keyframe
from mlscli.scenes.flight import Craft, fly
from mlscli.scenes.noise import Chances, Noise, displace
from mlscli.scenes.presets import make
from mlscli.scenes.scan_flight import fly_scan
from mlscli.scenes.scans import Scan
from mlscli.scenes.surfaces import Scatter
from mlscli.trials.quality import GRID, SCENES

FIRST, FLIGHTS = 101, 20
EXACT = Noise(sigma=Scatter(0.0, 0.0), salt_pepper=0.0)
# Noises by name: over scenes, sideways or across the ray, in height or along it.
OVER_SCENES = {
    "slam, sigma 0,0.02": Noise("slam", Scatter(0.0, 0.02), reference=2.0),
    "slam, sigma 0,0.05": Noise("slam", Scatter(0.0, 0.05), reference=2.0),
    "slam, sigma 0.05,0.05": Noise("slam", Scatter(0.05, 0.05), reference=2.0),
    "thesis, sigma 0.017,0.05": Noise("thesis", Scatter(0.05 / 3, 0.05)),
    "thesis, sigma 0,0.05": Noise("thesis", Scatter(0.0, 0.05)),
    "thesis, sigma 0.05,0.05": Noise("thesis", Scatter(0.05, 0.05)),
}
# Over scans: features a keyframe, and how high above the scan, in the usual height.
FLOWN = (
    *((1000, 1.0), (500, 1.0), (200, 1.0)),
    *((1000, 2.0), (500, 0.6), (300, 1.5), (100, 1.0)),
)
# Standard deviations in cells; in x and y, or across the ray, a third of them.
SIGMAS = (0.25, 0.5, 1.0)


def main() -> None:
    """Print the table."""
    found: Counter[tuple[str, str]] = Counter()
    flights: Counter[tuple[str, str]] = Counter()
    for what, noise, keyframes in (*over_scenes(), *over_scans()):
        flights[what, noise] += 1
        found[what, noise] += auto_noise(keyframes) > 0.0
    print("| flights over | noise | flights | noise found |")  # noqa: T201
    print("|:--|:--|--:|--:|")  # noqa: T201
    for (what, noise), count in flights.items():
        print(f"| {what} | {noise} | {count} | {found[what, noise]} |")  # noqa: T201


def over_scenes() -> Iterator[tuple[str, str, list[Keyframe]]]:
    """Yield flights: over what, the name of the noise, and the keyframes."""
    for number in range(FLIGHTS):
        seed = FIRST + number
        scene = make(SCENES[(3 * number + FIRST) % len(SCENES)])
        exact = fly(scene, GRID, EXACT, seed=seed).keyframes
        for name, noise in OVER_SCENES.items():
            yield "scenes", name, displaced(exact, noise, seed)


def over_scans() -> Iterator[tuple[str, str, list[Keyframe]]]:
    """Yield flights at one height over scans; see `over_scenes`."""
    for name in ("als_bridge", "footbridge", "als_underpass"):
        scan = Scan.of(name, SCANS[name].points(DATA))
        for number, (features, height) in enumerate(FLOWN):
            seed = FIRST + number
            craft = Craft(height * scan.usual_height)
            flight = fly_scan(scan, features, EXACT, craft, survey=True, seed=seed)
            clean = np.concatenate([keyframe.points for keyframe in flight.keyframes])
            sigma = SIGMAS[seed % len(SIGMAS)] * cell_of(clean)
            scatter = Scatter(sigma / 3, sigma)
            for noise in (Noise("slam", scatter, reference=flight.range), Noise("thesis", scatter)):
                yield name, noise.kind, displaced(flight.keyframes, noise, seed)


def displaced(keyframes: Sequence[Keyframe], noise: Noise, seed: int) -> list[Keyframe]:
    """Return keyframes with noise."""
    sizes = [len(keyframe.points) for keyframe in keyframes]
    points = np.concatenate([keyframe.points for keyframe in keyframes])
    cameras = np.repeat([keyframe.position for keyframe in keyframes], sizes, axis=0)
    sigma = np.tile(np.array(noise.sigma), (len(points), 1))
    moved = displace(points, cameras, sigma, noise, Chances(seed))
    return [
        Keyframe(part, keyframe.stamp, keyframe.position)
        for part, keyframe in zip(np.split(moved, np.cumsum(sizes)[:-1]), keyframes, strict=True)
    ]


if __name__ == "__main__":
    main()
