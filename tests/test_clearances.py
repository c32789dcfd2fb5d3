"""A craft under the bridge, through the window and into a closed box: one flight of the benchmark.

How one could cheat: to say `never seen` of all that is hard, so what is roomy must fit; to call all
space free that holds no patch, so nothing may fit into a box; to let the reference follow the
program, so it samples the scene's own surfaces and is tried on both sides of the true size.
"""

from __future__ import annotations

from functools import cache

import pytest

from benchmarks.clearances import NOISES, Trial, is_wrong, mapped, trials, truly_fits
from mlscli.maps.surface_map import SurfaceMap
from mlscli.queries.clearance import BLOCKED, FITS, NEVER_SEEN, clearance

TRIALS = {trial.name: trial for trial in trials()}
NOISE = NOISES["sigma 0.02"]


@cache
def flown(name: str) -> SurfaceMap:
    return mapped(TRIALS[name].scene, NOISE, seed=0)


def verdict(trial: Trial, width: float, height: float) -> int:
    return clearance(flown(trial.name), trial.corners, width, height).overall


@pytest.mark.parametrize(
    ("name", "craft", "expected"),
    [
        ("bridge of 2.0", (0.6, 1.5), FITS),
        ("bridge of 2.0", (0.6, 2.5), BLOCKED),
        ("window of 0.7", (0.5, 0.5), FITS),
        ("window of 0.7", (0.9, 0.9), BLOCKED),
        ("inside a box of 1", (0.2, 0.2), NEVER_SEEN),
    ],
)
def test_what_is_roomy_fits_and_what_is_not_does_not(
    name: str, craft: tuple[float, float], expected: int
) -> None:
    assert verdict(TRIALS[name], *craft) == expected


@pytest.mark.parametrize("name", ["bridge of 2.0", "window of 0.7", "inside a box of 1"])
def test_no_verdict_is_wrong(name: str) -> None:
    trial = TRIALS[name]
    for craft in trial.crafts:
        assert not is_wrong(trial, craft, verdict(trial, *craft))


@pytest.mark.parametrize(
    ("name", "fits", "fits_not"),
    [("bridge of 2.0", (0.6, 1.95), (0.6, 2.05)), ("window of 0.7", (0.65, 0.65), (0.75, 0.75))],
)
def test_the_reference_knows_the_true_sizes(
    name: str, fits: tuple[float, float], fits_not: tuple[float, float]
) -> None:
    trial = TRIALS[name]
    assert truly_fits(trial.scene, trial.corners, *fits)
    assert not truly_fits(trial.scene, trial.corners, *fits_not)
    assert is_wrong(trial, fits_not, FITS)
    assert is_wrong(trial, (0.3, 0.3), BLOCKED)
    assert is_wrong(TRIALS["inside a box of 1"], (0.01, 0.01), FITS)
