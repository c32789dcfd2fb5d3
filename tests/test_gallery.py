"""The gallery: its pictures are there, small, and all shown."""

from __future__ import annotations

import re
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from docs.gallery.render import View, render
from mlscli.mesh import build_mesh
from mlscli.mesh.colours import ARTIFICIAL_RED
from tests.helpers.maps import Patch, map_of
from tests.helpers.meshes import a_map, plane

DOCS = Path(__file__).resolve().parent.parent / "docs"
PICTURES = sorted((DOCS / "gallery").glob("*.png"))


def test_every_picture_is_shown_once_and_no_other() -> None:
    pages = "".join(page.read_text(encoding="utf-8") for page in DOCS.glob("*.md"))
    shown = re.findall(r"\]\(gallery/([^)]+)\)", pages)
    assert sorted(shown) == [picture.name for picture in PICTURES]


@pytest.mark.parametrize("picture", PICTURES, ids=lambda picture: picture.name)
def test_pictures_are_small_and_show_something(picture: Path) -> None:
    assert picture.stat().st_size <= 150_000
    image = matplotlib.image.imread(picture)[:, :, :3]
    assert np.mean(image.min(axis=2) < 0.9) > 0.05


def test_what_is_nearer_hides_what_is_behind_it() -> None:
    red = [Patch(x, y, 0.0, 0.0, 2, 0) for x, y, _, _ in plane(9, 9)]
    deck = [Patch(x, y, 3.0, 0.0, 0, 1) for x, y, _, _ in plane(9, 9)]
    for patches, hidden in ((red, False), (red + deck, True)):
        image = render(build_mesh(map_of(patches)), 90, View(elevation=89.9))
        middle = image[len(image) // 2, 45].astype(int)
        assert (middle[0] > 3 * middle[1]) is not hidden, ARTIFICIAL_RED


def test_a_picture_is_as_wide_as_told_and_filled() -> None:
    image = render(build_mesh(a_map(*plane(9, 9))), 120, View(elevation=90))
    assert image.shape[1] == 120
    assert np.mean(image.min(axis=2) < 250) > 0.4
