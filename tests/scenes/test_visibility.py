"""What cameras see, against plain loops that solve for the point where a ray meets a plane.

Ways to pass without being right: all is seen, or nothing; openings hide; surfaces hide from one
side only; the last camera counts instead of the first; far squares of the grid are not looked at.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

import mlscli.runtime.threads
from mlscli.runtime.arrays import Float64, Int32
from mlscli.scenes.parts import floor, wall
from mlscli.scenes.presets import make
from mlscli.scenes.sampling import sample
from mlscli.scenes.surfaces import Scene, Surface
from mlscli.scenes.visibility import first_seen
from tests.scenes.scenes import random_scene


def hides(surface: Surface, camera: Float64, point: Float64, openings: bool = True) -> bool:
    matrix = np.column_stack((surface.along, surface.across, camera - point))
    if abs(np.linalg.det(matrix)) < 1e-12:
        return False
    u, v, t = np.linalg.solve(matrix, camera - np.array(surface.corner))
    a, b = u * surface.lengths[0], v * surface.lengths[1]
    in_opening = openings and any(
        o.a_low < a < o.a_high and o.b_low < b < o.b_high for o in surface.openings
    )
    return bool(0 < t < 1 - 1e-7 and 0 <= u <= 1 and 0 <= v <= 1 and not in_opening)


def sees(
    scene: Scene, camera: Float64, direction: Float64, angle: float, reach: float,
    point: Float64, own: int, openings: bool = True,
) -> bool:  # fmt: skip
    ray = point - camera
    far = float(np.linalg.norm(ray))
    if far > reach or math.acos(np.clip(ray @ direction / far, -1, 1)) > math.radians(angle / 2):
        return False
    others = (s for number, s in enumerate(scene.surfaces) if number != own)
    return not any(hides(surface, camera, point, openings) for surface in others)


def cosine(angle: float) -> float:
    return math.cos(math.radians(angle / 2))


def cases() -> Iterator[tuple[Scene, Float64, Int32, Float64, Float64, float, float]]:
    rng = np.random.default_rng(11)
    for _ in range(40):
        scene = random_scene(rng, int(rng.integers(1, 12)))
        samples = sample(scene, 0.5)
        cameras = rng.uniform((-3, -3, -1), (3, 3, 4), (6, 3))
        directions = rng.normal(size=(6, 3))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        angle, reach = rng.uniform(40, 300), rng.uniform(1, 6)
        yield scene, samples.xyz, samples.surface, cameras, directions, angle, reach


def test_the_first_camera_that_sees_a_point_is_the_one_plain_loops_find() -> None:
    outcomes: dict[str, int] = {"seen": 0, "unseen": 0, "through": 0, "hidden": 0}
    for scene, points, surface, cameras, directions, angle, reach in cases():
        found = first_seen(scene, points, surface, cameras, directions, cosine(angle), reach)
        for i, point in enumerate(points):
            looks = [
                (scene, camera, direction, angle, reach, point, int(surface[i]))
                for camera, direction in zip(cameras, directions, strict=True)
            ]
            expected = next((k for k, look in enumerate(looks) if sees(*look)), -1)
            assert found[i] == expected
            solid = next((k for k, look in enumerate(looks) if sees(*look, False)), -1)
            alone = [(Scene("", (scene.surfaces[surface[i]],)), *look[1:6], 0) for look in looks]
            bare = any(sees(*look) for look in alone)
            outcomes["seen" if expected >= 0 else "unseen"] += 1
            outcomes["through"] += solid != expected
            outcomes["hidden"] += bare and expected < 0
    assert all(count > 50 for count in outcomes.values()), outcomes


def test_in_a_village_of_many_surfaces_none_is_overlooked() -> None:
    scene = make("village", size=4)
    samples = sample(scene, 0.7)
    rng = np.random.default_rng(2)
    cameras = rng.uniform((-9, -9, 0.2), (9, 9, 2.5), (12, 3))
    directions = np.tile([1.0, 0.0, 0.0], (12, 1))
    found = first_seen(
        scene, samples.xyz, samples.surface, cameras, directions, cosine(200.0), 12.0
    )
    chosen = rng.choice(len(samples.xyz), 150, replace=False)
    for i in chosen:
        expected = [
            k
            for k in range(12)
            if sees(
                scene, cameras[k], directions[k], 200.0, 12.0,
                samples.xyz[i], int(samples.surface[i]),
            )
        ]  # fmt: skip
        assert found[i] == (expected[0] if expected else -1)
    assert (found[chosen] >= 0).any()
    assert (found[chosen] < 0).any()


def look_down(scene: Scene, points: Float64, surface: int, height: float = 2.0) -> list[int]:
    numbers = np.full(len(points), surface, dtype=np.int32)
    down = np.array([[0.0, 0.0, -1.0]])
    camera = np.array([[0.0, 0.0, height]])
    found: list[int] = first_seen(
        scene, points, numbers, camera, down, cosine(120.0), 10.0
    ).tolist()
    return found


def test_what_lies_under_a_deck_is_seen_beside_it_and_through_a_hole_in_it() -> None:
    ground = floor(Scene(""), (-5, 5), (-5, 5), 0.0)
    points = np.array([[0.0, 0.0, 0.0], [1.9, 0.0, 0.0], [2.1, 0.0, 0.0]])
    assert look_down(floor(ground, (-1, 1), (-1, 1), 1.0), points, 0) == [-1, -1, 0]
    hole = [((-0.5, 0.5), (-0.5, 0.5))]
    with_hole = floor(ground, (-1, 1), (-1, 1), 1.0, openings=hole)
    assert look_down(with_hole, points, 0) == [0, -1, 0]


def test_where_surfaces_meet_neither_hides_the_seam() -> None:
    scene = wall(floor(Scene(""), (-1, 1), (-1, 1), 0.0), (-1, 1), (1, 1), (0.0, 1.0))
    assert look_down(scene, np.array([[0.5, 1.0, 0.0]]), 0) == [0]
    assert look_down(scene, np.array([[0.5, 1.0, 0.0]]), 1) == [0]


def test_threads_do_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = make("house-storeys")
    samples = sample(scene, 0.08)
    assert len(samples.xyz) > 2 * mlscli.runtime.threads.WORTHWHILE
    cameras = np.random.default_rng(5).uniform((-3, -3, 0), (3, 3, 4), (9, 3))
    directions = np.tile([0.0, 0.0, -1.0], (9, 1))
    found = []
    for processors in (1, 3):
        monkeypatch.setattr(mlscli.runtime.threads, "processors", lambda n=processors: n)
        found.append(
            first_seen(scene, samples.xyz, samples.surface, cameras, directions, cosine(120.0), 9.0)
        )
    assert np.array_equal(found[0], found[1])
    assert len(np.unique(found[0])) > 3
