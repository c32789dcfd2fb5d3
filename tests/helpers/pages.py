"""A map to look at, and its page in a browser."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from mlscli.maps.surface_map import SurfaceMap
from mlscli.view.page import write_page
from tests.helpers.browser import Browser
from tests.helpers.maps import Patch, map_of

CELL = 0.5
WIDE, DECK = 20, 3.0


def crossing(shift: int = 0) -> SurfaceMap:
    """Return a sloping ground with a wall, an artificial corner, and a deck over its middle.

    The flight saw the rows of the ground one after the other, and the deck at the end.
    """
    patches = []
    for x in range(-WIDE, WIDE):
        for y in range(-WIDE, WIDE):
            artificial = x >= 10 and y >= 10
            is_wall = x == -10
            height = 2.0 if is_wall else ground(x)
            depth = 2.0 - ground(x) if is_wall else 0.0
            origin = 2 if artificial else 0
            patches.append(Patch(x + shift, y, height, depth, origin, int(not artificial)))
            if abs(y) < 5 and abs(x) < 5:
                patches.append(Patch(x + shift, y, DECK, 0.0, 0, 4))
    surface = map_of(patches)
    first = np.where(surface.height == DECK, 2 * WIDE, surface.ix - shift + WIDE)
    first = np.where(surface.origin == 0, first, -1).astype(np.int32)
    route = np.zeros((2 * WIDE + 1, 4))
    route[:, 0] = 100 + np.arange(len(route)) / 2
    route[:, 1], route[:, 3] = (np.arange(-WIDE, WIDE + 1) + shift) * CELL, 6
    return replace(surface, first_keyframe=first, last_keyframe=first, route=route)


def ground(x: int) -> float:
    return 0.01 * x


def opened(browser: Browser, path: Path, surface: SurfaceMap, fragment: str = "") -> Browser:
    """Return the browser with the page of a map, at what stands behind the # of its address."""
    write_page(path, surface, title="<crossing> & more", overwrite=True)
    browser.errors.clear()
    browser.requests.clear()
    browser.open(path, fragment)
    return browser


def readout(page: Browser, x: float, y: float) -> dict[str, float]:
    """Return the numbers told of what is under the cursor."""
    page.mouse("mouseMoved", x, y)
    told = re.findall(r"\b(x|y|z|height|depth) (-?[\d.]+)", page.text("#readout"))
    return {name: float(value) for name, value in told}


def middle(page: Browser) -> tuple[float, float]:
    size = page.evaluate("[innerWidth, innerHeight]")
    return size[0] / 2, size[1] / 2


def painted(page: Browser) -> int:
    """Count pixels in colours, which neither the background has nor most of what is around."""
    picture = page.picture()[:480, 250:].astype(int)
    return int((picture.max(axis=2) - picture.min(axis=2) > 24).sum())
