"""The page in a real browser, driven as by a user, and looked at.

Ways to pass without being right: a program that fails in silence, so the console is read; boxes
that change and nothing else, so pixels are counted; a height that comes from the data and not
from what is seen, so the view is from below, too, and layers are hidden under the cursor.
"""

from __future__ import annotations

from dataclasses import replace
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from mlscli.errors import OutputError
from mlscli.maps.merging import merge_maps
from mlscli.maps.surface_map import SurfaceMap
from mlscli.runtime.arrays import Array
from mlscli.view.page import write_page
from tests.helpers.browser import Browser
from tests.helpers.maps import Patch, map_of
from tests.helpers.pages import CELL, DECK, WIDE, crossing, ground, middle, opened, painted, readout

FAR = 12_000_000  # cells


def reddish(picture: Array) -> int:
    """Count pixels that are shades of the artificial red, outside of the panel."""
    red, green, blue = np.moveaxis(picture[:, 250:].astype(int), 2, 0)
    return int(((red > 100) & (green < 0.2 * red) & (blue < 0.3 * red)).sum())


def test_it_loads_without_an_error_and_asks_for_nothing_else(page: Browser, tmp_path: Path) -> None:
    assert page.text("#title") == "<crossing> & more"
    assert page.errors == []
    assert page.requests == [(tmp_path / "map.html").as_uri()]
    assert not page.evaluate("document.querySelector('#failure').innerText")
    assert painted(page) > 20_000


def test_the_cursor_reads_what_is_seen_from_above_and_from_below(page: Browser) -> None:
    page.key("t")
    told = readout(page, *middle(page))
    # The craft's track, higher still, is no part of the map.
    assert (told["height"], told["z"]) == (DECK, DECK)
    page.evaluate("dispatchEvent(new KeyboardEvent('keydown', {key: 'r'}))")
    for _ in range(40):
        page.key("ArrowDown")
    told = readout(page, *middle(page))
    assert abs(told["height"]) < 0.011
    assert abs(told["z"]) < 0.011
    assert page.errors == []


def test_the_cursor_reads_the_patch_of_the_cell_under_it(page: Browser) -> None:
    page.key("t")
    x, y = middle(page)
    places = [(x + dx, y + dy) for dx in (-140, -110, 110, 150) for dy in (-140, 0, 140)]
    for place in places:
        told = readout(page, *place)
        assert told["height"] == pytest.approx(ground(int(np.floor(told["x"] / CELL))), abs=1e-3)
    # Where the cursor moves right, x grows, and where it moves down, y falls.
    left, right = readout(page, x - 150, y), readout(page, x + 150, y)
    above, below = readout(page, x + 150, y - 100), readout(page, x + 150, y + 100)
    assert left["x"] < -CELL < CELL < right["x"]
    assert below["y"] < right["y"] < above["y"]
    assert right["y"] == pytest.approx(0, abs=CELL)


def test_what_is_hidden_is_not_read(page: Browser) -> None:
    page.key("t")
    page.click("#layer-surface")
    assert readout(page, *middle(page)) == {}
    page.click("#layer-surface")
    assert readout(page, *middle(page))["height"] == DECK


def test_layers_switch_what_is_seen(page: Browser) -> None:
    page.key("t")
    whole, red = painted(page), reddish(page.picture())
    assert red > 500
    page.click("#layer-artificial")
    assert reddish(page.picture()) < red / 20
    page.click("#layer-artificial")
    assert reddish(page.picture()) == red
    for key in "123456":
        page.key(key)
    # Of the layers, points alone are left: 4 by 4 pixels each at most.
    assert 1000 < painted(page) < whole / 2
    assert page.evaluate("document.querySelector('#layer-patches').checked")
    page.key("6")
    assert painted(page) < 100


def test_walls_are_seen_from_the_side_and_switched_alone(page: Browser) -> None:
    page.click("#layer-surface")
    page.click("#layer-artificial")
    page.key("f")
    edge_on = painted(page)
    page.key("e")
    told = readout(page, *middle(page))
    assert told["depth"] == pytest.approx(2.0 - ground(-10), abs=1e-3)
    assert told["x"] == pytest.approx(-9.5 * CELL, abs=1e-3)
    broadside = painted(page)
    assert broadside > 2 * edge_on
    page.click("#layer-walls")
    assert painted(page) < broadside / 3


def test_colours_stand_for_what_is_chosen(page: Browser) -> None:
    names = page.evaluate("[...document.querySelector('#colouring').options].map((o) => o.value)")
    assert names == ["height", "origin", "variance", "uncertainty", "count", "time"]
    page.key("t")
    x, y = (int(place) for place in middle(page))
    # West and east of the deck, away from what is artificial: the flight went from west to east.
    rows = slice(y + 90, y + 120)
    west, east = (rows, slice(x - 150, x - 110)), (rows, slice(x + 110, x + 150))
    by_height, red = page.picture(), reddish(page.picture())
    page.evaluate(CHOOSE % "time")
    page.settle()
    by_time = page.picture()
    assert hue(by_time, west) == "blue"
    assert hue(by_time, east) == "red"
    assert (page.text("#lowest"), page.text("#highest")) == ("0", "20")
    assert "artificial" in page.text("#kinds")
    assert reddish(by_time) == pytest.approx(red, rel=0.05)
    page.evaluate(CHOOSE % "origin")
    page.settle()
    by_origin = page.picture()
    assert (by_origin[west].reshape(-1, 3) == by_origin[east].reshape(-1, 3)[0]).all()
    assert page.evaluate("document.querySelector('#ramp').hidden")
    assert reddish(by_origin) == pytest.approx(red, rel=0.05)
    for _ in range(5):
        page.key("c")
    # But for a row of pixels where two triangles meet, which the renderer gives to either.
    assert (page.picture() != by_height).any(axis=2).mean() < 1e-3 < (by_time != by_height).mean()
    assert hue(by_height, west) == hue(by_height, east) == "blue"
    assert page.errors == []


CHOOSE = (
    "(() => { const c = document.querySelector('#colouring'); c.value = '%s';"
    "c.dispatchEvent(new Event('change')); })()"
)


def hue(picture: Array, part: tuple[slice, slice]) -> str:
    """Tell which is more in a part of a picture, red or blue."""
    red, _, blue = picture[part].reshape(-1, 3).mean(axis=0)
    return "red" if red > blue else "blue"


def test_the_whole_is_seen_beside_the_panel_its_broad_side_in_front(
    browser: Browser, tmp_path: Path
) -> None:
    for long_in_x in (True, False):
        places = [(i, j) if long_in_x else (j, i) for i in range(60) for j in range(6)]
        surface = map_of([Patch(x, y, 0.1 * (x + y), 0.0, 0, 1) for x, y in places])
        page = opened(browser, tmp_path / f"{long_in_x}.html", surface)
        picture = page.picture().astype(int)
        colourful = picture.max(axis=2) - picture.min(axis=2) > 24
        colourful[:, :250] = False
        colourful[-110:] = False
        columns = np.flatnonzero(colourful.any(axis=0))
        assert columns[0] > 255
        assert columns[-1] < 1000 - 255
        assert columns[-1] - columns[0] > 300


def test_the_slider_uncovers_the_map(page: Browser) -> None:
    page.key("t")
    slide = (
        "(() => { const s = document.querySelector('#slider'); s.value = %d;"
        "s.dispatchEvent(new Event('input')); })()"
    )
    grown = []
    for keyframe in (0, 10, 20, 30):
        page.evaluate(slide % keyframe)
        page.settle()
        assert f"keyframe {keyframe + 1} of 41, {keyframe / 2:.1f} s" == page.text("#keyframe")
        grown.append(painted(page))
    assert grown == sorted(set(grown))
    # The deck comes last: until then the ground is seen, and read, in its place.
    assert readout(page, *middle(page))["height"] < 0.1
    page.evaluate(slide % 40)
    page.settle()
    assert readout(page, *middle(page))["height"] == DECK


def test_the_flight_plays_to_its_end(page: Browser) -> None:
    page.key(",")
    page.key(",")
    assert page.text("#keyframe").startswith("keyframe 39 ")
    page.key(" ")
    page.wait("document.querySelector('#play').textContent === '▶'")
    assert page.text("#keyframe").startswith("keyframe 41 ")


def test_dragging_turns_and_the_wheel_zooms_towards_the_cursor(page: Browser) -> None:
    page.key("t")
    x, y = middle(page)
    before = readout(page, x + 150, y + 100)
    page.mouse("mouseWheel", x + 150, y + 100, deltaX=0, deltaY=-400)
    after = readout(page, x + 150, y + 100)
    assert after["x"] == pytest.approx(before["x"], abs=0.05)
    assert after["y"] == pytest.approx(before["y"], abs=0.05)
    assert abs(readout(page, x, y)["x"]) > 0.1
    page.key("r")
    still = page.picture()
    page.mouse("mousePressed", x, y, button="left", buttons=1, clickCount=1)
    page.mouse("mouseMoved", x + 90, y, button="left", buttons=1)
    page.mouse("mouseReleased", x + 90, y, button="left", clickCount=1)
    assert (page.picture() != still).any(axis=2).sum() > 10_000
    assert page.errors == []


# Counts what is drawn, and lets each layer take its time.
WATCHED = """(() => {
  const drawing = WebGL2RenderingContext.prototype;
  const { drawElements, clear } = drawing;
  Object.assign(window, { frames: 0, elements: 0, patience: 0 });
  drawing.drawElements = function (mode, count, ...how) {
    const end = performance.now() + window.patience;
    while (performance.now() < end);
    window.elements += count;
    drawElements.call(this, mode, count, ...how);
  };
  drawing.clear = function (what) {
    window.frames += what === (this.COLOR_BUFFER_BIT | this.DEPTH_BUFFER_BIT);
    window.elements = 0;
    clear.call(this, what);
  };
})()"""
# Moves the view there and back again, without an end.
MOVING = """(() => {
  const key = (key) => dispatchEvent(new KeyboardEvent("keydown", { key }));
  window.moving = setInterval(() => { key("ArrowLeft"); key("ArrowRight"); }, 10);
})()"""
DETAIL = "document.documentElement.dataset.detail"


def test_a_slow_machine_draws_coarsely_what_moves_and_smoothly_what_rests(
    browser: Browser, tmp_path: Path
) -> None:
    page = opened(browser, tmp_path / "large.html", plain(180))
    assert page.evaluate(DETAIL) == "smooth"
    page.key("t")
    fine = page.picture()
    page.evaluate(WATCHED)
    page.evaluate("window.patience = 60")
    page.evaluate(MOVING)
    page.wait(f"{DETAIL} === 'coarse'")
    coarse = page.picture()
    assert page.evaluate("window.elements") < 3 * 179**2
    # The same is seen, but for the outline.
    assert ((coarse != fine).any(axis=2)).mean() < 0.1 < ((fine != 255).any(axis=2)).mean()
    page.evaluate("clearInterval(window.moving)")
    page.wait(f"{DETAIL} === 'smooth'")
    assert page.evaluate("window.elements") == 6 * 179**2
    assert (page.picture() == fine).all()
    assert page.errors == []


def plain(side: int) -> SurfaceMap:
    return map_of([Patch(x, y, 0.0, 0.0, 0, 1) for x in range(side) for y in range(side)])


def test_a_cursor_that_moves_draws_nothing_anew(page: Browser) -> None:
    page.key("t")
    page.evaluate(WATCHED)
    x, y = middle(page)
    told = {readout(page, x + step, y)["x"] for step in (0, 30, 60)}
    assert len(told) == 3
    assert page.evaluate("window.frames") == 0


def test_light_and_dark(page: Browser) -> None:
    shades = {page.picture()[300, 990].mean()}
    page.key("l")
    shades.add(page.picture()[300, 990].mean())
    assert min(shades) < 60 < 200 < max(shades)


def test_far_from_the_origin_nothing_is_lost(browser: Browser, tmp_path: Path) -> None:
    page = opened(browser, tmp_path / "far.html", crossing(FAR))
    page.key("t")
    x, y = middle(page)
    told = readout(page, x + 150, y)
    cell = int(np.floor(told["x"] / CELL)) - FAR
    assert 5 <= cell < WIDE
    assert told["height"] == pytest.approx(ground(cell), abs=1e-3)
    assert told["z"] == pytest.approx(0.01 * (told["x"] / CELL - FAR - 0.5), abs=1e-3)
    assert page.errors == []


def test_a_map_without_patches_is_an_empty_page_without_errors(
    browser: Browser, tmp_path: Path
) -> None:
    page = opened(browser, tmp_path / "empty.html", map_of([]))
    page.key("t")
    assert readout(page, *middle(page)) == {}
    assert page.errors == []


def test_a_title_cannot_end_the_element_it_stands_in(browser: Browser, tmp_path: Path) -> None:
    surface = replace(crossing(), frame_id="</script><script>document.title = 'taken'</script>")
    page = opened(browser, tmp_path / "map.html", surface)
    assert page.evaluate("document.title") == "<crossing> & more · mls"
    assert surface.frame_id in page.text("#about")


def test_a_frame_called_as_a_mark_of_the_template_is_no_mark(
    browser: Browser, tmp_path: Path
) -> None:
    surface = replace(crossing(), frame_id="/*DATA*/ /*HEADER*/ /*SCRIPT*/")
    page = opened(browser, tmp_path / "map.html", surface)
    assert surface.frame_id in page.text("#about")
    assert page.errors == []


def test_an_existing_page_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "map.html"
    path.write_text("mine")
    with pytest.raises(OutputError, match="exists already"):
        write_page(path, crossing())
    assert path.read_text() == "mine"


def test_a_stray_patch_far_away_costs_nothing_of_what_is_near(
    browser: Browser, tmp_path: Path
) -> None:
    # Too far for steps of a cell's thousandth to be counted.
    stray = map_of([Patch(2**30, 0, 1e6, 0.0, 0, 1)])
    surface = merge_maps(replace(crossing(), frame_id=stray.frame_id), stray)
    page = opened(browser, tmp_path / "stray.html", surface)
    page.key("t")
    x, y = middle(page)
    told = readout(page, x + 150, y)
    assert told["height"] == pytest.approx(ground(int(np.floor(told["x"] / CELL))), abs=1e-3)
    assert page.errors == []


def test_heights_and_depths_are_told_to_the_last_digit(browser: Browser, tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    heights, depths = rng.uniform(-9, 9, (2, 400))
    depths[::2] = 0
    depths[1] = 1e-9
    patches = [
        Patch(i % 20, i // 20, float(height), float(abs(depth)), 0, 1)
        for i, (height, depth) in enumerate(zip(heights, depths, strict=True))
    ]
    surface = map_of(patches)
    page = opened(browser, tmp_path / "map.html", surface)
    script = (resources.files("mlscli.view") / "web" / "data.js").read_text(encoding="utf-8")
    told = page.evaluate(
        f"(() => {{ {script}; return load().then((map) => "
        "[[...map.patches.height], [...map.patches.depth]]); })()"
    )
    assert told[0] == pytest.approx(surface.height, abs=5e-5 + 1e-9)
    assert told[1] == pytest.approx(surface.depth, abs=1e-3)
    assert [depth > 0 for depth in told[1]] == (surface.depth > 0).tolist()
