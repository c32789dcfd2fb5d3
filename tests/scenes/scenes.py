"""Random scenes, and points on them, for tests."""

from __future__ import annotations

import numpy as np

from mlscli.runtime.arrays import Float64
from mlscli.scenes.surfaces import Rectangle, Scene, add_horizontal, add_vertical


def random_scene(rng: np.random.Generator, surfaces: int = 8) -> Scene:
    """Return surfaces of every kind within 4 units; half of them have openings, walls stand."""
    scene = Scene("random")
    for _ in range(surfaces):
        x, y, z = rng.uniform((-2, -2, 0), (2, 2, 2)).tolist()
        length, width = rng.uniform(0.4, 3.0, 2).tolist()
        orientation = float(rng.choice([0, 90, rng.uniform(0, 360)]))
        a, b = rng.uniform(0.1, 0.5, 2) * (length, width)
        opening = Rectangle(a, a + 0.4 * length, b, b + 0.4 * width)
        if rng.random() < 0.5:
            grade = float(rng.choice([0, rng.uniform(-0.6, 0.6)]))
            # A slope is longer than it seems from above; its openings are told along it.
            openings = [opening] if rng.random() < 0.5 else []
            scene = add_horizontal(
                scene, (x, y, z), (length, width), orientation, grade, openings=openings
            )
        else:
            openings = [opening] if rng.random() < 0.5 else []
            grade = 0.0 if openings else float(rng.choice([0, rng.uniform(-0.6, 0.6)]))
            scene = add_vertical(
                scene, (x, y, z), (length, width), orientation, grade, openings=openings
            )
    return scene


def cloud(scene: Scene, spacing: float) -> list[tuple[Float64, Float64]]:
    """Return of each surface its points (N, 3), and their lengths (N, 2) along its edges."""
    parts = []
    for surface in scene.surfaces:
        length, width = surface.lengths
        a, b = (
            (np.arange(steps) + 0.5) / steps * edge
            for edge in (length, width)
            for steps in [max(1, int(np.ceil(edge / spacing)))]
        )
        ab = np.column_stack((np.repeat(a, len(b)), np.tile(b, len(a))))
        for o in surface.openings:
            inside = (ab > (o.a_low, o.b_low)) & (ab < (o.a_high, o.b_high))
            ab = ab[~inside.all(axis=1)]
        edges = np.array([surface.along, surface.across]) / np.array([[length], [width]])
        parts.append((np.array(surface.corner) + ab @ edges, ab))
    return parts
