"""What map_server makes of an image and its YAML file, by the rule that it documents."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml
from PIL import Image

from mlscli.maps.space import FREE, OCCUPIED, UNKNOWN


def served(file: Path) -> tuple[dict[tuple[int, int], int], dict[str, Any]]:
    """Return the state of each place, by whole cells of the map frame, and what the file says.

    Pixel by pixel: the image's last row is that of the least y, the origin the lower left corner of
    the lower left pixel.
    """
    told = yaml.safe_load(file.read_text(encoding="utf-8"))
    image = Image.open(file.parent / told["image"])
    assert image.mode == "L"
    assert told["mode"] == "trinary"
    assert told["negate"] == 0
    x, y, yaw = told["origin"]
    assert yaw == 0.0
    states = {}
    for row in range(image.height):
        for column in range(image.width):
            p = (255 - image.getpixel((column, row))) / 255  # type: ignore[operator]
            state = UNKNOWN
            if p > told["occupied_thresh"]:
                state = OCCUPIED
            elif p < told["free_thresh"]:
                state = FREE
            place = np.array((x, y)) / told["resolution"] + (column, image.height - 1 - row)
            cell = tuple(np.round(place).astype(int).tolist())
            np.testing.assert_allclose(place, cell, atol=1e-6)
            states[cell] = state
    return states, told
