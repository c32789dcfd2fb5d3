"""What each rule that improves on one of the thesis's is worth, and what else was tried.

Run it as ``python benchmarks/rules.py``; it takes a minute. Flights with 10 and 20 % outliers go
through the whole pipeline: over the thesis's scenes, on which the rules were tuned, and over eight
others. It prints means over the flights, and sums of patches. At last, over all scenes, in cells of
the size that `auto` finds, what sight lines do for wide gaps, with and without the rules that judge
by the surfaces around them.
"""

from __future__ import annotations

from statistics import mean

import numpy as np

from mlscli.building.sizes import auto_cell_size
from mlscli.config import load
from mlscli.maps.surface_map import SurfaceMap
from mlscli.parameters.fields import fields_of, write_value
from mlscli.pipeline.parameters import DEFAULT_PIPELINE
from mlscli.pipeline.stages.registry import STAGES
from mlscli.scenes.flight import Flight
from mlscli.scenes.presets import SCENE_PRESETS
from mlscli.scenes.truth import truth
from mlscli.scoring import Score, score
from mlscli.trials.quality import CELL_SIZE, flown
from mlscli.trials.staged import mapped

# What the default pipeline sets, and what a stage does where nothing is said.
DEFAULT = {
    f"{stage}.{name}": write_value(value)
    for stage, given in DEFAULT_PIPELINE.items()
    for name, value in given.items()
}
THESIS = {
    f"{stage}.{name}": write_value(fields_of(STAGES[stage])[name].default)
    for stage, given in DEFAULT_PIPELINE.items()
    for name in given
}
# They belong together: with a share asked for, more neighbours count, and fewer must be there.
_OF_MEDIAN = {
    f"median.{name}"
    for name in ("max_nb", "min_nb", "level", "min_share", "layer_share", "max_slope")
}
TUNED = (("bridge", "bridge-walls", "house", "planes", "planes-walls"), (11, 12))
_OTHERS = (
    *("table", "village-thesis", "house-storeys", "street"),
    *("tunnel", "stair", "parking", "bridge-gap"),
)
SHOWN = (_OTHERS, (21, 22))
SEEDS = (1, 2, 3)
# What sight lines are tried beside.
SIGHT_BESIDE: tuple[dict[str, str], ...] = (
    {},
    {"plaster.over_lower": "true"},
    {"plaster.support": "1"},
    {"plaster.support": "0"},
    {"plaster.support": "0", "plaster.over_lower": "true"},
)
SIGHT_HEAD = "| setting | sight | complete | correct | phantom | inserted | honest red |"
SIGHT_RULE = "|:--|--:|--:|--:|--:|--:|--:|"
HEAD = "| setting | complete | floors | walls | correct | rmse / sigma | missed | false | phantom |"
RULE = "|:--|--:|--:|--:|--:|--:|--:|--:|--:|"


def settings() -> dict[str, dict[str, str]]:
    """Return the settings to try, by name: parameters and their values."""
    named = {"the thesis's rules": THESIS}
    median = {name: value for name, value in DEFAULT.items() if name in _OF_MEDIAN}
    named["only level and slope of the median"] = {**THESIS, **median}
    others = {name: value for name, value in DEFAULT.items() if name not in _OF_MEDIAN}
    named |= {f"only `{name}={value}`": {**THESIS, name: value} for name, value in others.items()}
    named["all of these: the default"] = DEFAULT
    for name, values in (
        ("median.recentre", ("0.5 cells", "1 cell")),
        ("median.min_nb", ("3", "6")),
        ("median.max_nb", ("16", "32")),
        ("median.level", ("0.5 cells", "1 cell")),
        ("median.min_share", ("0.3", "0.5")),
        ("median.layer_share", ("0", "0.2", "0.4")),
        ("median.max_slope", ("0", "1")),
        ("median.nb_radius", ("2.5 cells", "4 cells")),
        ("orphans.horizontal", ("3 cells", "6 cells")),
        ("orphans.vertical", ("1 cell",)),
        ("orphans.min_share", ("0", "0.05")),
        ("orphans.min_neighbours", ("0", "3")),
        ("walls.join", ("1 cell", "3 cells")),
        ("walls.along", ("0", "1 cell")),
        ("walls.support", ("0", "2")),
        ("plaster.support", ("0", "1", "3")),
        ("plaster.over_lower", ("true",)),
        ("plaster.sight", ("0", "3 cells", "12 cells")),
        ("plaster.height_thresh", ("0.25", "1")),
        ("plaster.height_clearance", ("0.25 cells", "1 cell")),
        ("plaster.slope_reach", ("1 cell", "3 cells")),
        ("plaster.max_gap_enhanced", ("3 cells", "7 cells")),
        ("pyramids.height_factor_thresh", ("0.5", "3")),
    ):
        named |= {f"the default, `{name}={value}`": {**DEFAULT, name: value} for value in values}
    return named


def main() -> None:
    """Print both tables."""
    for title, (scenes, seeds) in (("Tuned on", TUNED), ("Shown on", SHOWN)):
        print(f"{title} {', '.join(scenes)}; seeds {', '.join(map(str, seeds))}\n")  # noqa: T201
        print(f"{HEAD}\n{RULE}")  # noqa: T201
        flights = [flown(s, share, seed) for s in scenes for share in (0.1, 0.2) for seed in seeds]
        truths: dict[int, SurfaceMap] = {}
        for name, chosen in settings().items():
            scores = [scored(flight, chosen, truths, i) for i, flight in enumerate(flights)]
            print(row(name, scores))  # noqa: T201
        print()  # noqa: T201
    print(f"All scenes, cells of auto, seeds {', '.join(map(str, SEEDS))}\n")  # noqa: T201
    print(f"{SIGHT_HEAD}\n{SIGHT_RULE}")  # noqa: T201
    flights = [flown(preset.name, 0.1, seed) for preset in SCENE_PRESETS for seed in SEEDS]
    clouds = [np.concatenate([each.points for each in flight.keyframes]) for flight in flights]
    sizes = [auto_cell_size(cloud) for cloud in clouds]
    truths = {}
    for values in SIGHT_BESIDE:
        for sight in ("0", "6 cells"):
            chosen = {**DEFAULT, **values, "plaster.sight": sight}
            scores = [
                scored(flight, chosen, truths, number, size)
                for number, (flight, size) in enumerate(zip(flights, sizes, strict=True))
            ]
            name = ", ".join(f"`{key}={value}`" for key, value in values.items()) or "the default"
            print(sight_row(f"{name} | {sight}", scores))  # noqa: T201


def sight_row(name: str, scores: list[Score]) -> str:
    """Return the row of a setting: means of shares, and sums of patches."""
    totals = [each.total for each in scores]
    shares = [
        mean(each.share for each in column if each.share is not None)
        for column in (
            [total.completeness for total in totals],
            [total.correctness for total in totals],
        )
    ]
    phantoms = [each.phantom_closings for each in scores]
    red = [each.honest_red for each in scores]
    honest = sum(each.count for each in red) / sum(each.of for each in red)
    sums = [sum(each.count for each in phantoms), sum(each.of for each in phantoms)]
    cells = [*(f"{share:.2%}" for share in shares), *(f"{n:,}" for n in sums), f"{honest:.1%}"]
    return f"| {' | '.join([name, *cells])} |"


def scored(
    flight: Flight,
    chosen: dict[str, str],
    truths: dict[int, SurfaceMap],
    number: int,
    cell_size: float = CELL_SIZE,
) -> Score:
    """Map a flight and score the map.

    Parameters
    ----------
    flight : Flight
    chosen : dict of str to str
        Parameters and their values.
    truths : dict of int to SurfaceMap
        Truths by the number of the flight; a missing one is computed and added.
    number : int
        The number of this flight.
    cell_size : float
        Side of the map's cells.
    """
    sets = [f"{name}={value}" for name, value in chosen.items()]
    surface = mapped(flight, load(None, [f"map.cell_size={cell_size}", *sets]))
    if number not in truths:
        lengths = surface.cell_size, surface.gap_size, surface.thickness
        truths[number] = truth(flight.scene, *lengths)
    return score(surface, truths[number])


def row(name: str, scores: list[Score]) -> str:
    """Return the row of a setting: means and sums of the scores of its maps."""
    totals = [each.total for each in scores]
    shares = [
        [total.completeness for total in totals],
        [total.completeness_horizontal for total in totals],
        [total.completeness_vertical for total in totals],
        [total.correctness for total in totals],
    ]
    cells = [
        f"{mean(each.share for each in column if each.share is not None):.2%}" for column in shares
    ]
    rmse = mean(total.heights.rmse or 0.0 for total in totals) / 0.05
    sums = (
        sum(each.levels_missed for each in scores),
        sum(each.false_levels for each in scores),
        sum(each.phantom_closings.count for each in scores),
    )
    return f"| {' | '.join([name, *cells, f'{rmse:.3f}', *(f'{n:,}' for n in sums)])} |"


if __name__ == "__main__":
    main()
