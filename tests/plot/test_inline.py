"""Maps and figures in notebooks, and pictures drawn into axes that the caller has.

How one could cheat: to show an old picture, so it is decoded and held against the figure's own; to
draw beside the axes that are given, so all others must stay empty.
"""

from __future__ import annotations

import io
import re
from base64 import b64decode
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import mlscli
from mlscli.errors import UsageError
from tests.helpers.maps import Patch, map_of

SURFACE = map_of(
    [Patch(ix, iy, 0.1 * ix, 0.0, iy % 3, 1) for ix in range(4) for iy in range(6)]
    + [Patch(2, 2, 2.0, 0.0, 0, 1)]
)


def test_a_map_shows_itself_from_above_and_in_numbers() -> None:
    html = SURFACE._repr_html_()
    assert html is not None
    (encoded,) = re.findall(r'src="data:image/png;base64,([^"]+)"', html)
    png = getattr(mlscli.plot_above(SURFACE), "_repr_png_")()  # noqa: B009
    assert b64decode(encoded) == png
    assert "25: 9 measured, 8 plastered, 8 artificial; 0 vertical" in html
    assert "23 cells with 1, 1 cell with 2" in html


def test_an_empty_map_shows_numbers_alone() -> None:
    html = SURFACE.take(np.zeros(SURFACE.size, dtype=np.bool_))._repr_html_()
    assert html is not None
    assert "<img" not in html
    assert "0: 0 measured" in html


def test_names_in_a_map_are_text_and_no_markup() -> None:
    html = replace(SURFACE, frame_id="<script>alert(1)</script>")._repr_html_()
    assert html is not None
    assert "<script>" not in html
    assert "&lt;script&gt;" in html


PLOTS: dict[str, Callable[[Axes | None], Figure]] = {
    "above": lambda axes: mlscli.plot_above(SURFACE, axes=axes),
    "section": lambda axes: mlscli.plot_section(SURFACE, (1.25, 0), (1.25, 3), axes=axes),
}


@pytest.mark.parametrize("name", PLOTS)
def test_what_is_drawn_into_given_axes_is_what_a_figure_of_its_own_shows(name: str) -> None:
    figure = Figure()
    given, other = figure.subplots(1, 2)
    assert PLOTS[name](given) is figure
    own = PLOTS[name](None).axes[0]
    kinds = [type(artist).__name__ for artist in own.get_children()]
    # In its own figure the legend is the figure's.
    drawn = [type(artist).__name__ for artist in given.get_children()]
    assert [kind for kind in drawn if kind != "Legend"] == kinds
    assert given.get_legend() is not None
    assert (own.get_xlim(), own.get_ylim()) == (given.get_xlim(), given.get_ylim())
    assert not other.has_data()
    figure.savefig(io.BytesIO())


def test_differences_take_three_axes() -> None:
    figure = Figure()
    parts = figure.subplots(1, 3)
    assert mlscli.plot_differences(SURFACE, SURFACE, axes=parts) is figure
    assert all(part.has_data() for part in parts)
    assert parts[2].get_xlabel() == "0 places where the maps differ"
    with pytest.raises(UsageError, match="2 are given; expected 3"):
        mlscli.plot_differences(SURFACE, SURFACE, axes=parts[:2])
