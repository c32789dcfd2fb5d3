"""Where on Earth the frame of a COLMAP model lies that was aligned to positions of its images.

``colmap model_aligner``, with ``ref_is_gps`` 1 and ``alignment_type`` enu, moves a model into the
frame with x east, y north and z up about the first of these positions. The model does not say that
it was aligned: whether it was is seen by its cameras, which then stand where the file says.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from mlscli.errors import MlsError
from mlscli.geometry.earth import is_place, local, local_georeference
from mlscli.io.files import open_text_input
from mlscli.maps.georeference import Georeference
from mlscli.words import some

NAMES = ("ref_images.txt", "reference.txt", "geo.txt", "gps.txt")
"""Names of the file: rows of an image's name, latitude, longitude and altitude."""

# So many cameras must be known; their median distance may be this share of how far they are spread.
_LEAST, _NEAR = 3, 0.1


def georeference_of(
    folder: Path, cameras: Mapping[str, tuple[float, float, float]]
) -> tuple[Georeference | None, list[str]]:
    """Return the georeference of a model, and a note on how it was found, or why not.

    Parameters
    ----------
    folder : Path
        That of the model; the file lies there, or in a folder above, up to that of the project
        (sparse/0 lies two below).
    cameras : mapping of str to tuple of float
        Where the camera of each image stands, by its name; NaN where not known.
    """
    folder = folder.resolve()
    places = (above / name for above in (folder, *folder.parents[:2]) for name in NAMES)
    file = next((place for place in places if place.is_file()), None)
    if file is None:
        return None, []
    try:
        rows = _rows(file)
    except (OSError, MlsError):
        rows = None
    if rows is None:
        return None, [
            f"{file}: cannot be read as rows of an image's name, latitude, longitude and altitude; "
            "`crs` says where the map lies"
        ]
    origin = next(iter(rows.values()))
    known = [name for name, place in cameras.items() if name in rows and math.isfinite(sum(place))]
    if len(known) < _LEAST:
        return None, [f"{file}: tells where {some(len(known), 'image')} of the model was, too few"]
    there = local(np.array([rows[name] for name in known]), origin)
    apart = np.linalg.norm(there - np.array([cameras[name] for name in known]), axis=1)
    spread = math.sqrt(float((there - there.mean(axis=0)).var(axis=0).sum()))
    off = float(np.median(apart))
    if not off <= _NEAR * spread:
        return None, [
            f"{file}: the cameras of the model stand {off:.3g} from where it says (median): the "
            "model is not aligned to it; colmap model_aligner does so, with ref_is_gps 1 and "
            "alignment_type enu"
        ]
    note = (
        f"{file}: tells where the map lies: {some(len(known), 'camera')} of the model, at "
        f"{off:.3g} m from where it says (median)"
    )
    return local_georeference(*origin, file.name), [note]


def _rows(file: Path) -> dict[str, tuple[float, float, float]] | None:
    """Return latitude, longitude and altitude by the name of the image; None where it has others.

    The first row is the origin, as COLMAP has it.
    """
    with open_text_input(file) as lines:
        return _parsed(lines)


def _parsed(lines: Iterable[str]) -> dict[str, tuple[float, float, float]] | None:
    rows: dict[str, tuple[float, float, float]] = {}
    for line in lines:
        words = line.replace(",", " ").split()
        if not words or words[0].startswith("#"):
            continue
        try:
            latitude, longitude, altitude = map(float, words[1:4])
        except ValueError:
            return None
        if not is_place(latitude, longitude, altitude):
            return None
        rows.setdefault(words[0], (latitude, longitude, altitude))
    return rows or None
