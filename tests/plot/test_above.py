"""The picture from above.

How one could cheat: numbers along the axes that are cut to their last digits.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mlscli.plot.above import plot_above
from tests.helpers.meshes import a_map, plane


def test_coordinates_of_a_survey_stand_in_full_along_the_axes() -> None:
    survey = a_map(*((ix + 572_270, iy + 4_498_560, h, d) for ix, iy, h, d in plane(6, 6)))
    figure = plot_above(survey)
    figure.canvas.draw()
    axes = figure.axes[0]
    east = [float(label.get_text()) for label in axes.get_xticklabels()]
    north = [float(label.get_text()) for label in axes.get_yticklabels()]
    assert all(572_270 <= each <= 572_276 for each in east)
    assert all(4_498_560 <= each <= 4_498_566 for each in north)


@pytest.mark.parametrize(("north", "told"), [(2.0, True), (-90.0, False)])
def test_the_legend_names_a_route_that_the_picture_has(north: float, told: bool) -> None:
    route = np.array([[0.0, 1.0, north, 3.0], [1.0, 3.0, north, 3.0]])
    figure = plot_above(replace(a_map(*plane(6, 6)), route=route))
    words = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    assert ("route" in words) == told
