"""The thesis's figures: what their captions claim holds, and could fail.

How one could cheat: claims that hold for whatever map there is; numbers of one map beside those of
the same map; a figure left out. Hence every figure is made once more without the stages in it, and
with stages that do too much, and then its claims must fail.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from benchmarks import figures as told
from benchmarks.shown import Claim, Shown, count_peaks, tables
from mlscli.config import load
from mlscli.maps.surface_map import SurfaceMap
from mlscli.parameters.fields import parameter
from mlscli.pipeline.parameters import Parameters
from mlscli.pipeline.stages.orphans import Orphans
from mlscli.pipeline.stages.plaster import Plaster
from mlscli.pipeline.stages.pyramids import Pyramids
from mlscli.pipeline.stages.stage import Stage
from mlscli.scenes.flight import Flight, fly
from mlscli.scenes.noise import Noise
from mlscli.scenes.surfaces import Scatter, Scene, add_horizontal
from mlscli.trials.staged import mapped
from tests.helpers.maps import GAP, Patch, map_of

FIGURES = (
    *(told.median, told.orphans, told.pyramids, told.plaster, told.sparse),
    *(told.batches, told.beside_the_bridge),
)


@pytest.fixture(scope="module")
def rows() -> list[Shown | Claim]:
    return list(told.figures())


def failed(rows: list[Shown | Claim]) -> list[str]:
    return [
        f"{row.figures}: {row.claim}" for row in rows if isinstance(row, Claim) and not row.holds
    ]


def test_every_claim_of_the_figures_holds(rows: list[Shown | Claim]) -> None:
    assert failed(rows) == []


@pytest.mark.parametrize("figure", FIGURES)
def test_the_claims_hold_whatever_the_seed(figure: told.Figure) -> None:
    assert failed(list(figure(7))) == []


# What a figure is not to show holds where nothing is done; a stage that does too much breaks it.
NOTHING_BAD = {
    "no true level does: missed",
    "of patches lowered, moved off a surface",
    "of patches lowered, in the walls and corners of the house",
    "the hole in the wall is closed in neither: of its 4 columns",
    "points are 16 times fewer, as on surfaces (text: 64, caption: 4)",
    "consistent: patches that differ",
    "x and y swapped: patches that differ from the mirrored map",
}


@pytest.mark.parametrize("figure", FIGURES)
def test_without_its_stages_nothing_is_left_of_a_figure(
    figure: told.Figure, monkeypatch: pytest.MonkeyPatch
) -> None:
    def bare(flight: Flight, parameters: Parameters) -> SurfaceMap:
        return mapped(flight, replace(parameters, pipeline=()))

    monkeypatch.setattr(told, "mapped", bare)
    monkeypatch.setattr(told, "along", lambda surface, *_: surface)
    claims = [row for row in figure(1) if isinstance(row, Claim)]
    assert {row.claim for row in claims if row.holds} <= NOTHING_BAD
    assert {row.claim for row in claims} - NOTHING_BAD


@dataclass(frozen=True)
class Greedy(Pyramids):
    """Lowers whatever it meets, by a factor that no configuration may have."""

    height_factor_thresh: float = parameter(-9.0, "below the least that is allowed")


@pytest.mark.parametrize(
    ("figure", "greedy", "broken"),
    [
        (told.orphans, Orphans(min_neighbours=12), ["no true level does: missed"]),
        (
            told.pyramids,
            Greedy(),
            ["moved off a surface", "walls and corners"],
        ),
        (told.beside_the_bridge, Plaster(min_x=0), ["x and y swapped"]),
    ],
)
def test_with_a_stage_that_does_too_much_a_figure_fails(
    figure: told.Figure, greedy: Stage, broken: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def overdone(flight: Flight, parameters: Parameters) -> SurfaceMap:
        stages = [greedy if stage.name == greedy.name else stage for stage in parameters.pipeline]
        return mapped(flight, replace(parameters, pipeline=tuple(stages)))

    monkeypatch.setattr(told, "mapped", overdone)
    told_failed = "; ".join(failed(list(figure(1))))
    assert all(part in told_failed for part in broken), told_failed


def test_no_figure_is_left_out(rows: list[Shown | Claim]) -> None:
    named = {name for row in rows for name in row.figures.replace(",", "").split()}
    expected = {
        "3.3",
        "3.4",
        "3.5",
        "3.6",
        "3.9",
        "3.10",
        "3.12",
        "3.13",
        "3.17",
        "3.18",
        "6.9",
        "6.10",
    }
    assert expected <= named


def test_the_tables_tell_every_map_and_claim(rows: list[Shown | Claim]) -> None:
    lines = list(tables(rows))
    assert len(lines) == len(rows) + 5
    assert lines[2].startswith("| 3.3, 3.5 | no stage | 3,720 | 1,597 | 0 | 320 | 0.0323 |")
    assert all(line.endswith("| holds |") for line in lines[lines.index("") + 3 :])
    fails = Claim("1.1", "less", [1, 0.5], holds=False)
    assert list(tables([fails]))[-1] == "| 1.1 | less | 1 | 0.5000 | DOES NOT HOLD |"


# --- what is seen on a map ---


def test_a_peak_rises_above_all_four_neighbours_by_half_again_what_they_differ() -> None:
    cross = [(0, 1, 0.0), (1, 0, 0.1), (1, 2, 0.0), (2, 1, 0.0)]
    around = [Patch(x, y, z, 0.0, 0, 1) for x, y, z in cross]
    for height, peaks in ((0.26, 1), (0.24, 0), (0.1, 0), (0.0 + GAP + 0.01, 0), (-0.5, 0)):
        middle = Patch(1, 1, height, 0.0, 0, 1)
        assert count_peaks(map_of([*around, middle])) == peaks
        assert count_peaks(map_of([*around[1:], middle])) == 0


def a_floor() -> Shown:
    """Return a floor of 8 by 8 cells with a hole of 2 by 2, closed at the height of the floor."""
    scene = add_horizontal(Scene("floor"), (0.6, 0.6, 0.0), (1.2, 1.2))
    flight = fly(scene, 0.15, Noise(sigma=Scatter(0, 0), salt_pepper=0), visibility=False)
    surface = mapped(flight, load("plain", ["map.cell_size=0.15"]))
    hole = (np.abs(surface.ix - 3.5) < 1) & (np.abs(surface.iy - 3.5) < 1)
    origin = np.where(hole, 2, 0).astype(np.uint8)
    return Shown("0", "floor", flight, surface.with_columns(origin=origin))


def test_what_is_inserted_is_found_in_the_box_where_it_is() -> None:
    floor = a_floor()
    assert np.count_nonzero(floor.inserted) == 4
    assert floor.closed((3, 5), (3, 5), (-0.1, 0.1)) == 4
    assert floor.closed((3, 4), (0, 8), (-0.1, 0.1)) == 2
    assert floor.closed((0, 3), (0, 8), (-0.1, 0.1)) == 0
    assert floor.closed((3, 5), (3, 5), (0.1, 1.0)) == 0


def test_a_patch_is_off_where_it_is_farther_from_the_truth_than_told() -> None:
    floor = a_floor()
    lifted = replace(floor, surface=replace(floor.surface, height=floor.surface.height + 0.1))
    assert not floor.off().any()
    assert lifted.off().all()
    assert not lifted.off(1.0).any()
