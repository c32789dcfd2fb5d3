"""Stages added one at a time, and the report of what each is worth.

How one could cheat: every map made with the whole pipeline, or with one stage alone; stages added
in the order of the pipeline; a stage that does nothing shown as if it did; sizes and noise of one
flight taken for all.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mlscli.building.depth_noise import auto_noise
from mlscli.building.sizes import fit_sizes
from mlscli.config import loads
from mlscli.errors import UsageError
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.parameters import Parameters
from mlscli.runtime.notices import hear
from mlscli.scenes.flight import Flight
from mlscli.scenes.noise import Noise
from mlscli.scenes.surfaces import Scatter
from mlscli.trials.quality import flown
from mlscli.trials.staged import Line, as_markdown, flown_by_share, maps_by_stage

SLAM = Noise("slam", Scatter(0.02, 0.02))


def over_planes(seed: int, noise: Noise | None = None) -> Flight:
    return flown("planes", 0.1, seed, noise=noise)


def stages_of(surface: SurfaceMap) -> list[str]:
    return [name for stage in surface.meta["parameters"]["pipeline"] for name in stage]


def test_each_map_has_one_stage_more_in_its_place_in_the_pipeline() -> None:
    parameters = loads("map: {cell_size: 0.15}\npipeline: [median, regions, plaster, orphans]")
    made = [(last, stages_of(*maps)) for last, maps in maps_by_stage([over_planes(1)], parameters)]
    assert made == [
        ("none", []),
        ("median", ["median"]),
        ("orphans", ["median", "orphans"]),
        ("plaster", ["median", "plaster", "orphans"]),
        ("regions", ["median", "regions", "plaster", "orphans"]),
    ]


def test_what_is_auto_is_that_of_each_flight() -> None:
    flights = [over_planes(1, SLAM), flown("planes", 0.1, 1, 0.2, SLAM)]
    fitted = [fit_sizes(flight.keyframes).parameters.map for flight in flights]
    sizes = [each.cell_size for each in fitted]
    assert sizes[0] != sizes[1]
    stages = list(maps_by_stage(flights, Parameters()))
    assert [last for last, _ in stages][:3] == ["none", "rays", "median"]
    for _, maps in stages:
        assert [surface.cell_size for surface in maps] == sizes
    noises = [
        surface.meta["parameters"]["pipeline"][0]["rays"]["noise"] for surface in stages[1][1]
    ]
    assert noises == [auto_noise(flight.keyframes) for flight in flights]
    assert min(noises) > 0


def test_a_stage_is_added_where_it_does_something_in_one_flight_at_least() -> None:
    same, grows = over_planes(1), over_planes(1, SLAM)
    parameters = Parameters().with_cell_size(0.3)
    alone = [last for last, _ in maps_by_stage([same], parameters)]
    assert alone == ["none", "median", "orphans", "plaster", "pyramids", "walls"]
    both = dict(maps_by_stage([same, grows], parameters))
    assert list(both) == ["none", "rays", *alone[1:]]
    # It moves what errs along the rays, and leaves the other flight as it is.
    unmoved, moved = (
        np.array_equal(before.height, after.height)
        for before, after in zip(both["none"], both["rays"], strict=True)
    )
    assert unmoved
    assert not moved


def test_noise_that_is_given_counts_and_not_what_the_flight_shows() -> None:
    for noise, added in ((0.02, True), (0, False)):
        parameters = loads(f"map: {{cell_size: 0.15}}\npipeline: [rays: {{noise: {noise}}}]")
        stages = [last for last, _ in maps_by_stage([over_planes(1)], parameters)]
        assert stages == ["none", "rays"][: 1 + added]


def test_every_site_is_flown_with_every_share_by_every_seed() -> None:
    told: list[tuple[str, int, int | None]] = []

    def fly(scene: str, share: float, seed: int) -> Flight:
        return replace(over_planes(1), attitudes=np.array([[len(scene), share, seed, 0]]))

    found = [
        (site, share, [tuple(flight.attitudes[0, :3]) for flight in flights])
        for site, share, flights in flown_by_share(
            ["a", "bc"], [0.0, 0.25], iter([3, 4]), fly, lambda *call: told.append(call)
        )
    ]
    assert found == [
        (site, share, [(len(site), share, 3), (len(site), share, 4)])
        for site in ("a", "bc")
        for share in (0.0, 0.25)
    ]
    assert told == [("a, 0%", 0, 2), ("a, 25%", 0, 2), ("bc, 0%", 1, 2), ("bc, 25%", 1, 2)]


def test_without_a_seed_nothing_is_flown() -> None:
    with pytest.raises(UsageError, match="`seeds`"):
        list(flown_by_share(["planes"], [0.1], [], lambda *_: over_planes(1)))


def test_the_report_has_a_table_for_each_site_and_names_what_is_worse() -> None:
    lines = [
        Line("a", 0.1, "none", False, ("1", "2")),
        Line("a", 0.1, "median", True, ("3", "")),
        Line("b", 0.0, "none", False, ("5", "6")),
    ]
    assert as_markdown(lines, ("x", "y"), "scene").splitlines() == [
        "## a",
        "",
        "| outliers | stages | x | y |",
        "|--:|:--|--:|--:|",
        "| 10% | none | 1 | 2 |",
        "| 10% | + median (worse) | 3 |  |",
        "",
        "## b",
        "",
        "| outliers | stages | x | y |",
        "|--:|:--|--:|--:|",
        "| 0% | none | 5 | 6 |",
        "",
        "## Stages that make a scene worse",
        "",
        "- median: a with 10% outliers",
    ]
    assert as_markdown(lines[2:], ("x", "y"), "scan").endswith("scan worse\n\nNone.\n")


def test_a_size_beyond_reason_is_doubted_once() -> None:
    told: list[str] = []
    hear(told.append)
    rough = over_planes(1, Noise("thesis", Scatter(0.5, 0.5)))
    next(maps_by_stage([rough, rough], loads("pipeline: [median]")))
    assert [line for line in told if "finer than the noise" in line] == told
    assert len(told) == 1
