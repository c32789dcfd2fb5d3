"""How depths err is found from what was seen from the same places.

How one could cheat: take the noise from neighbours in space, which it has chosen; let wrong
correspondences or edges count; call any scatter noise of depths; depend on which way is north or
up, or on the order of points; let everything be found, or nothing.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mlscli.building import depth_noise
from mlscli.building.build import build_map
from mlscli.building.depth_noise import DepthNoise, _errors, auto_noise
from mlscli.building.large import build_large
from mlscli.config import load
from mlscli.io.reading.recording import open_recording
from mlscli.io.writing.flight_bag import write_bag
from mlscli.io.writing.npz import read_map, write_map
from mlscli.keyframes.keyframe import Keyframe
from mlscli.runtime.arrays import Float64
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
    for scene in ("house", "tunnel", "bridge-gap", "parking"):
        assert auto_noise(flight("thesis", 0.05, scene).keyframes) == 0.0
        only_heights = Noise("thesis", Scatter(0.0, 0.05), 0.1)
        assert auto_noise(fly(make(scene), 0.15, only_heights, seed=4).keyframes) == 0.0
    assert auto_noise(flight("slam", 0.0, wrong=0.0).keyframes) == 0.0


def test_what_a_laser_measured_tells_nothing_of_triangulation() -> None:
    seen = flight("slam", 0.05).keyframes
    ranged = [replace(keyframe, is_ranged=True) for keyframe in seen]
    assert auto_noise(ranged) == 0.0
    assert auto_noise([*seen, *ranged]) == auto_noise(seen) > 0.0


def test_of_a_long_flight_some_looks_tell_what_all_do(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = flight("slam", 0.05, "street").keyframes
    found = auto_noise(seen)
    fitted = list[int]()

    def counting(ahead: Float64, depth: Float64) -> tuple[Float64, Float64]:
        fitted.append(len(ahead))
        return _errors(ahead, depth)

    monkeypatch.setattr(depth_noise, "_errors", counting)
    for most in (8, 16):
        monkeypatch.setattr(depth_noise, "_LOOKS", most)
        fitted.clear()
        assert 0.8 * found < auto_noise(seen) < 1.25 * found
        assert most <= len(fitted) < 0.8 * len(seen)


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


@pytest.mark.parametrize("about", [(0.0, 0.0, 90.0), (2.0, 0.0, 0.0), (31.0, -74.0, 118.0)])
def test_it_does_not_depend_on_the_axes(about: tuple[float, float, float]) -> None:
    turn = Rotation.from_euler("xyz", about, degrees=True).as_matrix()
    for seen in (flight("slam", 0.05).keyframes, flight("thesis", 0.05, "tunnel").keyframes):
        turned = [
            Keyframe(k.points @ turn.T, k.stamp, tuple((turn @ k.position).tolist())) for k in seen
        ]
        assert auto_noise(turned) == auto_noise(seen)


def test_it_does_not_depend_on_the_order_of_points_and_little_on_how_keyframes_are_cut() -> None:
    seen = flight("slam", 0.05).keyframes
    noise = auto_noise(seen)
    rng = np.random.default_rng(5)
    mixed = [Keyframe(rng.permutation(k.points), k.stamp, k.position) for k in seen]
    assert auto_noise(mixed) == noise
    halves = [Keyframe(k.points[i::2], k.stamp, k.position) for k in seen for i in (0, 1)]
    assert auto_noise(halves) == pytest.approx(noise, rel=0.25)


def rough(sigma: float, noise: float, seed: int) -> list[Keyframe]:
    """Return a flight at one height over ground that is rough, and steps down behind its middle."""
    rng = np.random.default_rng(seed)
    keyframes = []
    for x in np.arange(0.0, 40.0, 0.5):
        ground = rng.uniform((x - 9, -9), (x + 9, 9), (80, 2))
        height = np.where(ground[:, 0] > 20, -1.5, 0.0) + rng.normal(0, sigma, 80)
        craft = np.array([x, 0.0, 6.0])
        sight = np.column_stack([ground, height]) - craft
        depth = np.linalg.norm(sight, axis=1)
        wrong = 1 + rng.normal(0, noise, 80) * depth
        keyframes.append(Keyframe(craft + sight * wrong[:, None], position=(x, 0.0, 6.0)))
    return keyframes


def test_rough_ground_is_no_noise_of_depths() -> None:
    for seed in range(5):
        assert auto_noise(rough(0.15, 0.0, seed)) == 0.0
        assert 0.8 * 0.006 < auto_noise(rough(0.05, 0.006, seed)) < 2 * 0.006


def test_of_a_long_recording_some_points_are_kept_evenly(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = flight("slam", 0.05).keyframes
    noise = auto_noise(seen)
    monkeypatch.setattr(depth_noise, "_KEPT", 500)
    looked_at = DepthNoise()
    for keyframe in seen:
        looked_at.add(keyframe)
    assert looked_at.value == noise
    total = sum(len(keyframe.points) for keyframe in seen)
    kept = np.concatenate(looked_at._kept)
    assert 500 <= len(kept) <= 1000 < total
    # One of 2, 4, 8, ... of them, from the first to the last.
    assert total / len(kept) == pytest.approx(2 ** round(np.log2(total / len(kept))), rel=0.01)


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
