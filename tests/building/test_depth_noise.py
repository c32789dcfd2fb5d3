"""How depths err is found from what was seen from the same places.

How one could cheat: take the noise from neighbours in space, which it has chosen; let wrong
correspondences or edges count; call any scatter noise of depths; depend on which way is north.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mlscli.building.build import build_map
from mlscli.building.depth_noise import auto_noise
from mlscli.building.large import build_large
from mlscli.config import load
from mlscli.io.reading.recording import open_recording
from mlscli.io.writing.flight_bag import write_bag
from mlscli.io.writing.npz import read_map, write_map
from mlscli.keyframes.keyframe import Keyframe
from mlscli.scenes.flight import Flight, fly
from mlscli.scenes.noise import Noise
from mlscli.scenes.presets import make
from mlscli.scenes.surfaces import Scatter


def flight(kind: str, sigma: float, scene: str = "house", wrong: float = 0.1) -> Flight:
    noise = Noise(kind, Scatter(0.0 if kind == "slam" else sigma / 3, sigma), wrong)  # type: ignore[arg-type]
    return fly(make(scene), 0.15, noise, seed=3)


@pytest.mark.parametrize("scene", ["house", "street", "parking"])
def test_it_is_what_the_flight_was_made_with(scene: str) -> None:
    for sigma in (0.02, 0.05):
        # At a depth of 2 by definition of the flights.
        true = sigma / 4
        assert 0.8 * true < auto_noise(flight("slam", sigma, scene, 0.0).keyframes) < 1.5 * true
        assert 0.8 * true < auto_noise(flight("slam", sigma, scene).keyframes) < 2 * true


def test_it_is_none_where_errors_do_not_grow_with_the_depth() -> None:
    assert auto_noise(flight("thesis", 0.05).keyframes) == 0.0
    assert auto_noise(flight("slam", 0.0, wrong=0.0).keyframes) == 0.0


@pytest.mark.filterwarnings("error")
def test_it_is_none_where_nothing_tells() -> None:
    seen = flight("slam", 0.05).keyframes
    nowhere = [Keyframe(keyframe.points, keyframe.stamp) for keyframe in seen]
    assert auto_noise(nowhere) == auto_noise([]) == auto_noise(seen[:2]) == 0.0
    rng = np.random.default_rng(1)
    here = Keyframe(np.zeros((500, 3)), position=(0.0, 0.0, 0.0))
    assert auto_noise([here]) == 0.0
    beyond = [Keyframe(k.points, k.stamp, (1e200, 0.0, 0.0)) for k in seen]
    assert auto_noise(beyond) == 0.0
    outlier = Keyframe(np.array([[1e200, 0.0, 0.0]]), 0.0, seen[0].position)
    assert auto_noise([outlier, *seen]) == auto_noise(seen)
    shell = rng.standard_normal((5000, 3))
    shell /= np.linalg.norm(shell, axis=1)[:, None]
    shell *= 1 + rng.normal(0, 0.05, (5000, 1))
    # All at one depth: whether errors grow is not to be seen.
    assert auto_noise([Keyframe(shell, position=(0.0, 0.0, 0.0))]) == 0.0


def test_neither_turns_nor_keyframes_cut_in_two_change_much() -> None:
    seen = flight("slam", 0.05).keyframes
    noise = auto_noise(seen)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turned = [
        Keyframe(k.points @ turn.T, k.stamp, tuple((turn @ k.position).tolist())) for k in seen
    ]
    assert auto_noise(turned) == pytest.approx(noise, rel=0.05)
    halves = [Keyframe(k.points[i::2], k.stamp, k.position) for k in seen for i in (0, 1)]
    assert auto_noise(halves) == pytest.approx(noise, rel=0.25)


def test_a_build_finds_it_and_says_so_whatever_memory_it_may_take(tmp_path: Path) -> None:
    flown = flight("slam", 0.05)
    write_bag(tmp_path / "flight.mcap", flown.keyframes, flown.attitudes, "mcap")
    noise = auto_noise(open_recording(tmp_path / "flight.mcap").keyframes())
    parameters = load(None, ["map.cell_size=0.4"])
    surface = build_map(tmp_path / "flight.mcap", parameters)
    assert surface.meta["parameters"]["pipeline"][0]["rays"]["noise"] == noise > 0
    assert surface.meta["sizes"]["noise"] == f"auto: a depth errs by {noise:g} times its square"
    with build_large(open_recording(tmp_path / "flight.mcap"), parameters, 2**31) as made:
        assert made.surface.meta["sizes"] == surface.meta["sizes"]
        write_map(tmp_path / "large.npz", made.surface)
    assert read_map(tmp_path / "large.npz") == surface
    without = load(None, ["map.cell_size=0.4", "rays.noise=0"])
    assert surface != build_map(tmp_path / "flight.mcap", without)
