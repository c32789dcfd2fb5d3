"""Measuring, cutting, the view in the address and saved pictures, in a real browser.

Ways to pass without being right: a length taken from the picture and not from the places, so they
are held to what the cursor reads; a cut that hides and is still read, or read and still seen; an
address that is written and never read; a saved picture that is empty, as what WebGL drew is gone
after its frame.
"""

from __future__ import annotations

import base64
import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mlscli.runtime.arrays import Array
from tests.helpers.browser import Browser, telephone
from tests.helpers.pages import CELL, DECK, crossing, ground, middle, opened, painted, readout

HASH = "location.hash"


def click(page: Browser, x: float, y: float, *, to: tuple[float, float] | None = None) -> None:
    """Press the mouse at a pixel, and release it there or elsewhere."""
    button: dict[str, Any] = {"button": "left", "clickCount": 1}
    page.mouse("mouseMoved", x, y)
    page.mouse("mousePressed", x, y, buttons=1, **button)
    if to:
        page.mouse("mouseMoved", *to, buttons=1, button="left")
    page.mouse("mouseReleased", *(to or (x, y)), **button)


def measured(page: Browser) -> dict[str, float]:
    """Return the lengths that the page tells of what was measured."""
    rows = (line.split() for line in page.text("#measured").splitlines())
    return {row[0]: float(row[1]) for row in rows if len(row) == 2}


def test_two_clicks_measure_between_the_places_under_them(page: Browser) -> None:
    page.key("t")
    x, y = middle(page)
    deck, beside = (x, y), (x + 150, y + 40)
    here, there = readout(page, *deck), readout(page, *beside)
    page.key("m")
    assert page.text("#measured") == "Click where to measure from."
    click(page, *deck)
    assert "measure to" in page.text("#measured")
    # The cursor stands for the second end until it is clicked.
    readout(page, *beside)
    moving = measured(page)
    click(page, *beside)
    across = np.hypot(here["x"] - there["x"], here["y"] - there["y"])
    rise = here["z"] - there["z"]
    assert rise == pytest.approx(DECK - ground(int(there["x"] // CELL)), abs=0.02)
    right = {"distance": np.hypot(across, rise), "horizontal": across, "vertical": rise}
    assert measured(page) == moving == pytest.approx(right, abs=2e-3)
    # It is kept while the view turns, and a third click begins anew.
    page.key("ArrowLeft")
    assert measured(page) == moving
    click(page, *deck)
    assert "measure to" in page.text("#measured")
    page.key("Escape")
    assert page.text("#measured") == ""
    assert page.errors == []


def test_what_is_dragged_or_hits_nothing_measures_nothing(page: Browser) -> None:
    page.key("m")
    x, y = middle(page)
    click(page, x, y, to=(x + 60, y))
    click(page, page.evaluate("innerWidth") - 30, 300)
    assert page.text("#measured") == "Click where to measure from."


def test_a_cut_opens_the_map_and_the_cursor_reads_what_lies_behind(page: Browser) -> None:
    page.key("t")
    x, y = middle(page)
    for _ in range(3):
        page.key("x")
    # At half the height from the craft's deepest ground to the walls and the deck.
    assert page.evaluate("document.querySelector('#cut').value") == "z"
    assert readout(page, x, y)["height"] == pytest.approx(0, abs=0.02)
    below = painted(page)
    page.key("o")
    assert readout(page, x, y)["height"] == DECK
    assert readout(page, x + 150, y) == {}
    assert painted(page) < below / 2
    # To the upper end of the map: below all of it, and not above any.
    slide(page, "max")
    assert readout(page, x, y) == {}
    page.key("o")
    assert readout(page, x, y)["height"] == DECK
    slide(page, "min")
    assert readout(page, x, y) == {}
    page.key("o")
    assert readout(page, x, y)["height"] == DECK
    for _ in range(2):
        page.key("x")
    assert page.evaluate("document.querySelector('#cut').value") == ""
    assert readout(page, x, y)["height"] == DECK
    assert page.errors == []


def slide(page: Browser, end: str) -> None:
    """Move the cut to its "min" or "max"."""
    page.evaluate(
        f"cutSlider = document.querySelector('#cut-at'); cutSlider.value = cutSlider.{end}"
    )
    page.evaluate("cutSlider.dispatchEvent(new Event('input'))")
    page.settle()


def test_a_cut_goes_through_the_place_that_it_tells(page: Browser) -> None:
    page.key("t")
    page.key("x")
    for _ in range(5):
        page.key("]")
    place = float(page.text("#cut-told").removeprefix("at "))
    x, y = middle(page)
    pixels = np.arange(x - 200, x + 200, 10)
    read = [readout(page, pixel, y + 90).get("x") for pixel in pixels]
    seen = [value for value in read if value is not None]
    assert len(seen) < len(read)
    assert max(seen) <= place
    step = seen[-1] - seen[-2]
    assert max(seen) == pytest.approx(place, abs=step)


def test_across_what_is_seen_the_nearer_half_goes(page: Browser) -> None:
    page.key("e")
    for _ in range(10):
        page.key("ArrowUp")
    x, y = middle(page)
    near, far = readout(page, x, y + 120), readout(page, x - 100, y - 60)
    assert far["x"] < 0 < near["x"]
    page.evaluate(
        "(() => { const c = document.querySelector('#cut'); c.value = 'seen';"
        "c.dispatchEvent(new Event('change')); })()"
    )
    page.settle()
    assert readout(page, x, y + 120) == {}
    assert readout(page, x - 100, y - 60) == far


def test_the_address_brings_back_what_is_seen(page: Browser, tmp_path: Path) -> None:
    for key in "tx]m5":
        page.key(key)
    x, y = middle(page)
    click(page, x - 100, y)
    click(page, x - 30, y + 50)
    for _ in range(3):
        page.key(",")
    page.key("c")
    page.key("ArrowDown")
    readout(page, x - 60, y)
    before, lengths, address = page.picture(), measured(page), page.evaluate(HASH)
    assert len(lengths) == 3
    opened(page, tmp_path / "again.html", crossing(), address)
    readout(page, x - 60, y)
    assert page.evaluate(HASH) == address
    assert measured(page) == pytest.approx(lengths, abs=2e-3)
    # Angles and places are rounded in the address: by less than a pixel, mostly.
    assert (page.picture() != before).any(axis=2).mean() < 0.02
    assert page.text("#keyframe").startswith("keyframe 38 ")
    # An address that is changed by hand, while the page is open.
    page.evaluate("location.hash = '#keyframe=3'")
    page.wait("document.querySelector('#keyframe').textContent.startsWith('keyframe 3 ')")
    page.settle()
    assert page.text("#measured") == ""
    assert page.errors == []


@pytest.mark.parametrize(
    "fragment",
    [
        "#view=a,b&cut=%E0&layers=&measure=1",
        "#view=0,0,0,1,2,3",
        "#view=1,2,Infinity,4,5,6&keyframe=1e9",
        "#cut=x,0,0,0&colour=<b>&measure=,,,,,",
        "#cut=constructor,1,1,1&view&=&&==",
    ],
)
def test_an_address_of_anybody_does_no_harm(
    browser: Browser, tmp_path: Path, fragment: str
) -> None:
    page = opened(browser, tmp_path / "map.html", crossing(), fragment)
    assert page.errors == []
    assert page.text("#keyframe").startswith("keyframe 41 ")
    page.key("r")
    assert painted(page) > 20_000 or "layers=" in fragment


def test_a_saved_picture_is_what_is_seen(page: Browser) -> None:
    page.evaluate(
        "(() => { const known = URL.createObjectURL; URL.createObjectURL = (blob) => {"
        "const reader = new FileReader(); reader.onload = () => { window.saved = reader.result; };"
        "reader.readAsDataURL(blob); return known.call(URL, blob); };"
        "HTMLAnchorElement.prototype.click = function () { window.named = this.download; }; })()"
    )
    page.key("m")
    x, y = (int(place) for place in middle(page))
    click(page, x - 80, y)
    click(page, x + 20, y)
    page.click("#save")
    page.wait("window.saved !== undefined")
    assert page.evaluate("window.named") == "<crossing> & more.png"
    saved, seen = picture(page.evaluate("window.saved")), page.picture()
    assert saved.shape == seen.shape
    part = slice(180, 480), slice(260, None)
    # What lies over the map is mixed with it by whoever puts them together.
    assert np.abs(saved[part].astype(int) - seen[part]).max() <= 2
    # The scale stands in its foot, as long as the bar of the page.
    foot = (saved[-30:, 14:250] < 80).all(axis=2).sum(axis=1).max()
    assert foot == pytest.approx(page.evaluate("document.querySelector('#bar').offsetWidth"), abs=2)
    assert page.errors == []


def picture(address: str) -> Array:
    from PIL import Image

    png = base64.b64decode(address.partition(",")[2])
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))


def test_on_a_telephone_nothing_hides_the_map(browser: Browser, tmp_path: Path) -> None:
    with telephone(browser):
        page = opened(browser, tmp_path / "map.html", crossing())
        folded = area(page, "#panel")
        assert folded < 0.05 * 420 * 800
        assert not page.evaluate("document.querySelector('#panel').open")
        assert readout(page, *middle(page))["height"] <= DECK
        page.click("#panel summary")
        assert area(page, "#panel") > 4 * folded
        page.key("?")
        for part in ("#panel", "#flight", "#told", "#help", "#scale"):
            left, top, right, bottom = box(page, part)
            assert left >= 0, part
            assert top >= 0, part
            assert right <= 420, part
            assert bottom <= 800, part
        assert box(page, "#panel")[3] <= box(page, "#flight")[1]
        assert box(page, "#scale")[3] <= box(page, "#flight")[1]
        assert page.errors == []


def box(page: Browser, selector: str) -> list[float]:
    """Return left, top, right and bottom of an element, in pixels."""
    found: list[float] = page.evaluate(
        f"(() => {{ const b = document.querySelector({selector!r}).getBoundingClientRect();"
        "return [b.left, b.top, b.right, b.bottom]; })()"
    )
    return found


def area(page: Browser, selector: str) -> float:
    left, top, right, bottom = box(page, selector)
    return (right - left) * (bottom - top)
