"""Whether a craft fits, as the page computes it by clicks, held to the library in a real browser.

Ways to pass without being right: to agree where all is free, or all is blocked, so ways lead under
a deck, through walls, holes and space that nobody saw; to agree on the worst verdict alone, so each
stretch is compared, and the distance and place where it is narrowest.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mlscli.maps.free_space import FreeSpace
from mlscli.maps.surface_map import SurfaceMap
from mlscli.queries.clearance import FITS, VERDICTS, clearance
from mlscli.runtime.arrays import Float64
from mlscli.view.fitting import seen_runs
from tests.helpers.browser import Browser, telephone
from tests.helpers.pages import CELL, crossing, middle, opened, readout
from tests.view.test_page_tools import area, click

ROUTE = [(-8.0, -3.0, 1.2), (-3.4, 0.3, 1.5), (3.1, 0.2, 1.4), (3.0, 4.9, 1.1), (7.2, 8.0, 0.9)]


def seen_crossing(seed: int, share: float) -> SurfaceMap:
    """Return the crossing, seen through in most voxels up to 4 above the ground, but for holes."""
    surface = crossing()
    rng = np.random.default_rng(seed)
    cells = np.unique(np.column_stack((surface.ix, surface.iy)), axis=0).astype(np.int32)
    levels = np.arange(1, 16)
    lines = (rng.uniform(size=(len(cells), len(levels))) < share) * rng.integers(
        1, 5, (len(cells), len(levels))
    )
    # A box that nobody looked into.
    box = (abs(cells[:, 0] - 6) < 3) & (abs(cells[:, 1] - 10) < 3)
    lines[box] = 0
    kept = lines > 0
    some = kept.any(axis=1)
    counts = kept[some].sum(axis=1)
    ix, iy = cells[some].T
    free = FreeSpace(
        ix.copy(),
        iy.copy(),
        np.concatenate(([0], np.cumsum(counts))),
        np.broadcast_to(levels, kept.shape)[kept].astype(np.int32),
        lines[kept].astype(np.uint8),
    )
    spread = np.where(surface.count > 0, 0.04, np.nan)
    top, bottom = surface.top + spread, surface.bottom - spread
    noise = np.where(surface.count > 0, 0.01, np.nan).astype(np.float32)
    return replace(surface, top=top, bottom=bottom, noise=noise, free=free)


def fragment(craft: tuple[float, float], way: Float64) -> str:
    """Return the address of a page in which a craft flies a way."""
    numbers = [*craft, 0.0, *way.ravel().tolist()]
    return f"#fit={','.join(map(str, numbers))}"


def told(page: Browser) -> tuple[str, float, list[tuple[float, float, str]]]:
    """Return the verdict, the least distance, and the stretches that the page tells."""
    lines = page.text("#fitted").splitlines()
    least = re.match(r"narrowest (-?[\d.]+) at ", lines[1])
    parts = [re.match(r"([\d.]+) to ([\d.]+) (.+)", line) for line in lines[2:]]
    stretches = [(float(part[1]), float(part[2]), part[3]) for part in parts if part]
    return lines[0], float(least[1]) if least else np.inf, stretches


@pytest.mark.parametrize(
    ("seed", "share", "craft"),
    [(1, 0.97, (0.4, 0.3)), (2, 0.9, (1.3, 0.8)), (3, 0.99, (0.9, 2.2)), (4, None, (0.6, 0.5))],
)
def test_the_page_tells_what_the_library_does(
    seed: int, share: float | None, craft: tuple[float, float], browser: Browser, tmp_path: Path
) -> None:
    surface = crossing() if share is None else seen_crossing(seed, share)
    way = np.array(ROUTE) + np.random.default_rng(seed).uniform(-0.2, 0.2, (len(ROUTE), 3))
    way = np.round(way, 3)
    found = clearance(surface, way, *craft)
    page = opened(browser, tmp_path / "map.html", surface, fragment(craft, way))
    assert page.errors == []
    overall, least, stretches = told(page)
    assert overall == VERDICTS[found.overall]
    # What lies beyond patches is rounded up by a 1024th of a cell.
    assert least == pytest.approx(found.distance.min(), abs=CELL / 250)
    right = [(part.begin, part.end, VERDICTS[part.verdict]) for part in found.stretches]
    assert len({part[2] for part in right}) > 1
    assert [part[2] for part in stretches] == [part[2] for part in right][:6]
    for mine, its in zip(stretches, right, strict=False):
        assert mine[:2] == pytest.approx(its[:2], abs=2e-3)
    assert ("does not say what was seen" in page.text("#fitted")) == (share is None)


def test_clicks_set_the_way_and_sizes_and_undo_change_it(page: Browser) -> None:
    page.key("t")
    x, y = middle(page)
    page.key("v")
    assert page.text("#fitted") == "Click where the craft flies."
    for name, value in (("width", 0.4), ("height", 0.4), ("above", 1.0)):
        page.evaluate(
            f"(() => {{ const f = document.querySelector('#fit-{name}'); f.value = {value};"
            "f.dispatchEvent(new Event('input')); })()"
        )
    here, there = readout(page, x - 100, y), readout(page, x - 30, y + 50)
    click(page, x - 100, y)
    click(page, x - 30, y + 50)
    way = np.array([[place["x"], place["y"], place["z"] + 1.0] for place in (here, there)])
    found = clearance(crossing(), way, 0.4, 0.4)
    _, least, stretches = told(page)
    assert least == pytest.approx(found.distance.min(), abs=CELL / 250)
    assert stretches[-1][1] == pytest.approx(found.pieces.along[-1], abs=3e-3)
    address = page.evaluate("location.hash")
    assert "fit=0.400" in address
    page.key("Backspace")
    assert told(page)[2][-1][1] == 0
    page.key("v")
    assert page.text("#fitted") == ""
    assert page.errors == []


def test_a_craft_that_is_none_and_an_address_of_anybody_do_no_harm(
    browser: Browser, tmp_path: Path
) -> None:
    page = opened(browser, tmp_path / "map.html", crossing(), "#fit=0,1,2,3,4,5")
    assert page.text("#fitted") == "A craft has a width and a height, up to 500."
    for words in ("fit=1", "fit=a,b,c", "fit=1,1,1,1e300,1e300,0,0,0,0", "fit=,,"):
        page = opened(browser, tmp_path / "map.html", crossing(), f"#{words}")
        assert page.errors == []


def test_on_a_telephone_the_craft_is_named_in_the_panel_and_clicked_beside_it(
    browser: Browser, tmp_path: Path
) -> None:
    with telephone(browser):
        page = opened(browser, tmp_path / "map.html", crossing())
        page.click("#panel summary")
        page.click("#fit")
        for part in ("#fit-width", "#fit-height", "#fit-above", "#fit-undo", "#fit-legend"):
            assert area(page, part) > 400, part
        page.click("#panel summary")
        click(page, *middle(page))
        assert page.text("#fitted").splitlines()[0] in VERDICTS
        assert area(page, "#told") < 0.25 * 420 * 800


def test_voxels_that_were_seen_are_kept_as_runs() -> None:
    surface = seen_crossing(5, 0.8)
    assert surface.free is not None
    kept = seen_runs(replace(surface, route=surface.route[:0]))
    assert kept is not None
    cells = np.repeat(np.arange(len(kept["ix"])), kept["count"])
    voxels = {
        (int(kept["ix"][cell]), int(kept["iy"][cell]), iz)
        for cell, low, length in zip(cells, kept["low"], kept["length"], strict=True)
        for iz in range(low, low + length)
    }
    free = surface.free
    column = np.repeat(np.arange(len(free.ix)), np.diff(free.start))
    right = zip(free.ix[column], free.iy[column], free.iz, free.lines, strict=True)
    assert voxels == {(int(x), int(y), int(z)) for x, y, z, lines in right if lines >= 2}
    assert seen_runs(crossing()) is None
    assert FITS == 0
