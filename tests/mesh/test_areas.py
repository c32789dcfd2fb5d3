"""The mesh of a true map has the area of the scene, eroded by half a cell.

The scene's surfaces are rastered here, each in its own plane. A place counts where its plane, or
what joins it there (a floor at a wall, a wall at a corner), goes on for half a cell to all sides:
a mesh ends at the centres of cells. Heights are not eroded.

Ways to pass without being right: to join what the scene has not joined, or leave a wall open, where
this cancels in the sum or is small in it; so floors and walls are compared each for themselves.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
import pytest

from mlscli.mesh import Mesh, build_mesh
from mlscli.runtime.arrays import Bool, Float64
from mlscli.scenes.presets import make
from mlscli.scenes.surfaces import Scene, Surface
from mlscli.scenes.truth import truth
from tests.helpers.meshes import areas

CELL, FINE = 0.15, 4
HALF = CELL / 2


class Plane(NamedTuple):
    """A surface's own axes: unit vectors, lengths, and its surface."""

    surface: Surface
    corner: Float64
    u: Float64
    v: Float64
    length: float
    width: float

    @classmethod
    def of(cls, surface: Surface) -> Plane:
        u, v = np.array(surface.along), np.array(surface.across)
        length, width = float(np.linalg.norm(u)), float(np.linalg.norm(v))
        return cls(surface, np.array(surface.corner), u / length, v / width, length, width)

    @property
    def is_wall(self) -> bool:
        return bool(abs(np.cross(self.u, self.v)[2]) < 1e-9)

    @property
    def is_post(self) -> bool:
        """Whether it is a wall one cell long, which stands by itself."""
        return self.is_wall and self.length < 1.5 * CELL

    def holds(self, a: Float64, b: Float64) -> Bool:
        within = (a > -1e-9) & (a < self.length + 1e-9) & (b > -1e-9) & (b < self.width + 1e-9)
        for o in self.surface.openings:
            edge = 1e-9
            inside = (a > o.a_low + edge) & (a < o.a_high - edge)
            within &= ~(inside & (b > o.b_low + edge) & (b < o.b_high - edge))
        return np.asarray(within)

    def raster(self) -> tuple[Float64, float]:
        """Return places evenly spread over it (N, 3), and the area of each."""
        n, m = (max(1, round(side / CELL * FINE)) for side in (self.length, self.width))
        a, b = ((np.arange(k) + 0.5) / k for k in (n, m))
        a, b = (grid.ravel() for grid in np.meshgrid(a * self.length, b * self.width))
        there = self.holds(a, b)
        places = self.corner + a[there, None] * self.u + b[there, None] * self.v
        area = self.length * self.width / (n * m)
        return places, area * float(np.linalg.norm(np.cross(self.u, self.v)))

    def under(self, places: Float64) -> Bool:
        """Tell where a floor is, within a cell in height of places."""
        across = np.linalg.inv(np.array([self.u[:2], self.v[:2]]).T)
        a, b = across @ (places[:, :2] - self.corner[:2]).T
        z = self.corner[2] + a * self.u[2] + b * self.v[2]
        return np.asarray(self.holds(a, b) & (np.abs(z - places[:, 2]) < CELL))

    def beside(self, places: Float64, margin: float) -> Bool:
        """Tell where a wall is at most half a cell from places, and as high within a margin."""
        a = np.clip((places - self.corner) @ self.u, 0, self.length)
        b = (places - self.corner) @ self.v
        off = places - self.corner - a[:, None] * self.u
        near = np.hypot(off[:, 0], off[:, 1]) < 1.01 * HALF
        within = np.clip(b, 0, self.width)
        return np.asarray(near & (np.abs(b - within) <= margin) & self.holds(a, within))


def expected(scene: Scene) -> tuple[float, float]:
    """Return the areas of the floors and of the walls, eroded by half a cell."""
    planes = [Plane.of(surface) for surface in scene.surfaces]
    flat = [plane for plane in planes if not plane.is_wall]
    upright = [plane for plane in planes if plane.is_wall]
    floors, walls = 0.0, 0.0
    for number, plane in enumerate(flat):
        places, area = plane.raster()
        # What lies in another floor is counted once.
        kept = np.ones(len(places), dtype=np.bool_)
        for other in flat[:number]:
            kept &= ~other.under(places)
        for step in product((-0.999, 0, 0.999), repeat=2):
            moved = places + np.array([*step, 0.0]) * HALF
            goes_on = [other.under(moved) for other in flat]
            goes_on += [other.beside(moved, 1e-6) for other in upright]
            kept &= np.any(goes_on, axis=0)
        floors += np.count_nonzero(kept) * area
    for plane in upright:
        if plane.is_post:
            # Drawn by itself: two quads half a cell wide.
            walls += 2 * HALF * plane.width
            continue
        places, area = plane.raster()
        kept = np.ones(len(places), dtype=np.bool_)
        for side in (-0.999, 0.999):
            moved = places + side * HALF * plane.u
            a, b = (moved - plane.corner) @ plane.u, (moved - plane.corner) @ plane.v
            joined = [other.beside(moved, 0.0) for other in upright if other is not plane]
            kept &= np.any([*joined, plane.holds(a, b)], axis=0)
        walls += np.count_nonzero(kept) * area
    return floors, walls


def measured(mesh: Mesh) -> tuple[float, float]:
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles], 1, 0)
    is_wall = np.abs(np.cross(b - a, c - a)[:, 2]) < 1e-12
    return float(areas(mesh)[~is_wall].sum()), float(areas(mesh)[is_wall].sum())


@pytest.mark.parametrize(
    "name",
    [
        *("bridge", "bridge-walls", "planes", "planes-walls", "gym", "village-thesis"),
        *("bridge-gap", "house-storeys", "tunnel", "parking", "table", "street"),
    ],
)
def test_floors_and_walls_have_the_area_of_the_scene(name: str) -> None:
    scene = make(name)
    mesh = build_mesh(truth(scene, CELL, 0.5, CELL))
    floors, walls = expected(scene)
    assert measured(mesh)[0] == pytest.approx(floors, rel=0.02)
    assert measured(mesh)[1] == pytest.approx(walls, rel=0.02, abs=1e-9)
    assert (areas(mesh) > 1e-6 * CELL**2).all()


def test_steps_of_a_wall_lower_than_the_slope_allowed_are_slopes_and_all_else_as_the_scene() -> (
    None
):
    # The tops of both sides of the stair rise five times, the foot of its second step twice.
    scene, rise, slopes = make("stair"), 0.18, 2 * 5 + 2
    floors, walls = measured(build_mesh(truth(scene, CELL, 0.5, CELL)))
    known = expected(scene)
    assert walls == pytest.approx(known[1] + slopes * CELL * rise / 2, rel=1e-6)
    assert floors == pytest.approx(known[0], rel=0.02)
    assert floors + walls == pytest.approx(sum(known), rel=0.02)


def test_the_gable_of_the_house_is_closed_and_all_else_as_the_scene() -> None:
    # Between eaves and roof less than `gap_size` is open, which makes one patch of both.
    scene = make("house")
    floors, walls = measured(build_mesh(truth(scene, CELL, 0.5, CELL)))
    eaves, ridge, half = 1.5, 1.95, 11 * CELL
    front = 2 * (half - HALF) * (ridge - eaves) * (half - HALF) / half / 2
    at_sides = 21 * CELL * (ridge - eaves) * HALF / half + 2 * 13 * CELL * 0.02
    known = expected(scene)
    assert floors == pytest.approx(known[0], rel=0.02)
    closing = front + at_sides
    assert floors + walls == pytest.approx(sum(known) + closing, abs=closing / 2)


@pytest.mark.parametrize("gap_size", [0.4, 0.3, CELL])
def test_the_house_has_its_area_where_the_map_tells_eaves_and_roof_apart(gap_size: float) -> None:
    scene = make("house")
    mesh = build_mesh(truth(scene, CELL, gap_size, CELL))
    assert sum(measured(mesh)) == pytest.approx(sum(expected(scene)), rel=0.02)
