"""Which columns of a text hold the poses of a craft: the formats of trajectories that are in use.

- TUM RGB-D, as most write it: ``stamp x y z qx qy qz qw``, and what else follows, such as the
  covariances of OpenVINS or the numbers of RTAB-Map's nodes; or ``stamp x y z`` alone.
- EuRoC, Kimera, OKVIS, evo: a header with these names, in any order, such as ``#timestamp [ns],
  p_RS_R_x [m], ..., q_RS_w []``; so have topics that were printed as text
  (``field.pose.position.x``).
- VINS-Mono and VINS-Fusion: eleven columns without a header, ``stamp,x,y,z,qw,qx,qy,qz,vx,vy,vz``.
  EuRoC's ground truth without its header has seventeen, w first as well; so have poses of other
  programs whose stamps are whole nanoseconds and which commas part.
- KITTI: twelve columns, a matrix 3 x 4 row by row, without stamps; or sixteen, 4 x 4, and either
  with a stamp before them.
- Redwood, ScanNet: a matrix 4 x 4 on four lines, one below the other, without stamps.
- ``x y z qx qy qz qw`` without stamps.
- Attitudes before positions, with stamps or without; told by what has length 1.
- g2o: ``VERTEX_SE3:QUAT id x y z qx qy qz qw`` or ``VERTEX_SE2 id x y theta``, among other lines.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from mlscli.io.clouds.columns import Layout
from mlscli.io.clouds.dialect import number
from mlscli.io.clouds.opening import Opening
from mlscli.io.plausibility.clocks import SECONDS_BELOW
from mlscli.runtime.arrays import Float64

POSITION, QUATERNION = ("x", "y", "z"), ("qx", "qy", "qz", "qw")
TUM = ("stamp", *POSITION, *QUATERNION)
W_LAST, W_FIRST = "x y z w", "w x y z"
_EUROC = (*TUM[:4], "qw", "qx", "qy", "qz")
_TURNED = {W_LAST: QUATERNION, W_FIRST: _EUROC[4:]}
MATRIX = tuple(f"m{row}{column}" for row in range(3) for column in range(4))

GRAPH = ("VERTEX_SE3:QUAT", "VERTEX_SE2", "VERTEX2")
"""Words that begin a line of a g2o file with a pose."""

_EDGES = ("EDGE_SE3:QUAT", "EDGE_SE2", "EDGE2", "VERTEX3", "EDGE3", "FIX")
_LAST_ROW = (0, 0, 0, 1)

# Rows that show what a text holds, and how far quaternions may be from length 1.
_FIRST_ROWS = 20
_ROUNDED = 1e-3
# Columns of programs that write w first and no header.
_W_FIRST = (11, 17)
_ANGLES = ("roll", "pitch", "yaw")
# As photogrammetry names the angles of its cameras: Pix4D, Metashape, Bentley.
_OF_CAMERAS = {*POSITION, "omega", "phi", "kappa"}
_IMAGE = re.compile(r".*\.(jpe?g|png|tiff?|dng|bmp|heic|webp)", re.IGNORECASE)
_ROTATION = [0, 1, 2, 4, 5, 6, 8, 9, 10]
_AXIS = re.compile(r"(.*?)[._/: ]*([xyzw])")
_TURNS = re.compile(r"(.*[._/: ])?(q([._].*)?|.*(quat|orient|rotation|attitude).*)")
_PLACES = re.compile(r"(.*[._/: ])?([pt]?|p[._].*|.*(pos|position|translation))")
_NANOSECONDS = re.compile(r"(.*[._/: ])?n(ano)?secs?")
_STAMPS = re.compile(r"(.*[._/: ])?(t|time|ts|secs?|.*time_?stamps?|.*stamps?)(_?n?s(ecs?)?)?")


class PoseColumns(NamedTuple):
    """Which columns hold poses.

    Attributes
    ----------
    layout : Layout
        Of the names in `TUM` or `MATRIX`; without stamp or quaternion where there are none.
    order : str
        In which order the numbers of the quaternion are taken to stand, `W_LAST` or `W_FIRST`,
        where it is told by the format only; empty where they have names, or there are none.
    """

    layout: Layout
    order: str = ""

    @property
    def is_turned(self) -> bool:
        """Whether attitudes are taken to stand before positions, though no name says so."""
        return bool(self.order) and self.layout.places["qx"] < self.layout.places["x"]


def by_names(opening: Opening) -> PoseColumns | None:
    """Return the columns that a header or comment names; None where it names no positions."""
    for header in (*opening.headers, *reversed(opening.comments)):
        for names in opening.names(header):
            if len(names) < opening.width or not opening.width:
                continue
            places = _named(names)
            if places and max(places.values()) < opening.width:
                return PoseColumns(Layout(places, len(names)))
    return None


def by_numbers(
    rows: Sequence[Sequence[str]], width: int, separator: str = ""
) -> PoseColumns | None:
    """Return the columns that hold poses by their values; None where none do, or it is unclear.

    Parameters
    ----------
    rows : sequence of sequence of str
        The fields of the first rows.
    width : int
        How many fields most rows have.
    separator : str
        Of the fields; empty for blanks.
    """
    values = _values(rows, width)
    if values is None:
        return None
    in_time = _grow(values[:, 0])
    for before in (0, 1):
        if width - before in (12, 16) and _are_matrices(values[:, before:]):
            return PoseColumns(ordered((*TUM[:before], *MATRIX)))
    if width in _W_FIRST and in_time and _are_unit(values[:, 4:8]):
        return PoseColumns(ordered(_EUROC), W_FIRST)
    is_timed = width >= len(TUM) and in_time
    first = is_timed and separator == "," and values[0, 0] >= SECONDS_BELOW
    order = W_FIRST if first else W_LAST
    stamp = TUM[:1] if is_timed else ()
    rest = values[:, len(stamp) :]
    if not is_timed and width != len(TUM) - 1:
        return None
    if _are_unit(rest[:, 3:7]):
        return PoseColumns(ordered((*stamp, *POSITION, *_TURNED[order])), order)
    if rest.shape[1] == len(TUM) - 1 and _are_unit(rest[:, :4]):
        return PoseColumns(ordered((*stamp, *_TURNED[order], *POSITION)), order)
    return None


def by_position(width: int) -> PoseColumns | None:
    """Return the columns of the plain format: stamp x y z, or with a quaternion."""
    if width not in (4, len(TUM)):
        return None
    return PoseColumns(ordered(TUM[:width]), W_LAST if width > 4 else "")


def are_poses_of_a_craft(opening: Opening) -> bool:
    """Return whether rows that are to be points are poses.

    Each has a stamp of its own, ascending, and a quaternion of length 1, or a matrix that turns and
    moves; or they are vertices of a graph of poses, or cameras with the angles of photogrammetry,
    or each with the name of an image of its own. Other names are no evidence: points may stand
    beside the pose from which they were seen.
    """
    rows, width = opening.rows[:_FIRST_ROWS], opening.width
    if (rows and rows[0][0] in (*GRAPH, *_EDGES)) or are_blocks_of_matrices(opening):
        return True
    lines = (*opening.headers, *opening.comments)
    if len(rows) > 1 and any(_are_images(words) for words in zip(*rows, strict=False)):
        return True
    if any({*names} >= _OF_CAMERAS for line in lines for names in opening.names(line)):
        return True
    named = by_names(opening)
    if named is None:
        found = by_numbers(rows, width)
        timed = found is not None and "stamp" in found.layout.places
        wide = width <= len(TUM) or len(rows) > 1
        return found is not None and wide and (timed or "m00" in found.layout.places)
    places, values = named.layout.places, _values(rows, width)
    if values is None or "stamp" not in places or len(rows) < 2:
        return False
    if "qw" not in places:
        names = next(opening.names(" ".join((*opening.headers, *opening.comments))), [])
        return {*_ANGLES} <= {*names} and _grow(stamps_of(values, places))
    return _grow(stamps_of(values, places)) and _are_unit(
        values[:, [places[name] for name in QUATERNION]]
    )


def are_blocks_of_matrices(opening: Opening) -> bool:
    """Return whether every four rows are a matrix 4 x 4, which turns and moves."""
    values = _values([row for row in opening.rows if len(row) == len(_LAST_ROW)], len(_LAST_ROW))
    whole = 0 if values is None else len(values) // 4 * 4
    return values is not None and whole > 0 and _are_matrices(values[:whole].reshape(-1, 16))


def columns_of_positions(opening: Opening) -> str:
    """Return the option `columns` that reads the positions of poses; empty where none can."""
    found = _found(opening)
    if found is None:
        # What follows the name of an image is where it was taken.
        columns = enumerate(zip(*opening.rows[:_FIRST_ROWS], strict=False))
        image = next((place for place, words in columns if _are_images(words)), opening.width)
        beyond = image + len(POSITION) < opening.width
        return ",".join(["-"] * (image + 1) + [*POSITION]) if beyond else ""
    places = found.layout.places
    axes = {place: axis for axis, place in places.items() if axis in POSITION}
    # The last column of a matrix.
    axes = axes or {places[f"m{row}3"]: axis for row, axis in enumerate(POSITION)}
    return ",".join(axes.get(place, "-") for place in range(max(axes) + 1))


def are_places_of_images(opening: Opening) -> bool:
    """Return whether poses are no more than where images were taken, in no known columns."""
    is_graph = bool(opening.rows) and opening.rows[0][0] in (*GRAPH, *_EDGES)
    return not is_graph and not are_blocks_of_matrices(opening) and _found(opening) is None


def _found(opening: Opening) -> PoseColumns | None:
    return by_names(opening) or by_numbers(opening.rows, opening.width, opening.dialect.separator)


def stamps_of(values: Float64, places: Mapping[str, int]) -> Float64:
    """Return the stamps of rows (N, columns), with the nanoseconds that have a column, (N,)."""
    stamps: Float64 = values[:, places["stamp"]]
    beside = places.get("nanoseconds")
    return stamps if beside is None else stamps + 1e-9 * values[:, beside]


def ordered(names: Sequence[str]) -> Layout:
    """Return the layout of columns in this order."""
    return Layout({name: place for place, name in enumerate(names)})


def _are_images(words: Sequence[str]) -> bool:
    """Return whether words are names of images, no two alike."""
    return len({*words}) == len(words) and all(_IMAGE.fullmatch(word) for word in words)


def _named(names: Sequence[str]) -> dict[str, int]:
    """Return the index of each part of a pose; none where a coordinate is missing.

    Of several columns with such a name, as a velocity or another pose, the first count.
    """
    places = dict[str, int]()
    for place, name in enumerate(names):
        axis = _AXIS.fullmatch(name)
        if axis and _TURNS.fullmatch(axis[1]):
            places.setdefault(f"q{axis[2]}", place)
        elif axis and axis[2] != "w" and _PLACES.fullmatch(axis[1]):
            places.setdefault(axis[2], place)
        elif _NANOSECONDS.fullmatch(name) and places.get("stamp") == place - 1:
            # Of the seconds before them.
            places["nanoseconds"] = place
        elif _STAMPS.fullmatch(name):
            places.setdefault("stamp", place)
    if not {*POSITION} <= {*places}:
        return {}
    if not {*QUATERNION} <= {*places}:
        places = {name: place for name, place in places.items() if name not in QUATERNION}
    return {name: places[name] for name in (*TUM, "nanoseconds") if name in places}


def _values(rows: Sequence[Sequence[str]], width: int) -> Float64 | None:
    """Return the first rows as numbers (N, width); None where not all are such rows."""
    some = rows[:_FIRST_ROWS]
    if not some or any(len(row) != width for row in some):
        return None
    return np.array([[_number(word) for word in row] for row in some])


def _number(word: str) -> float:
    """Return the number that a word is; NaN where it is none, as it may not be needed."""
    try:
        return number(word)
    except ValueError:
        return np.nan


def _grow(stamps: Float64) -> bool:
    return bool((stamps[1:] > stamps[:-1]).all())


def _are_unit(quaternions: Float64) -> bool:
    # The numbers may be of any size; results are only compared.
    with np.errstate(over="ignore", invalid="ignore"):
        lengths = np.sqrt(np.square(quaternions).sum(axis=1))
        return bool((np.abs(lengths - 1) < _ROUNDED).all())


def _are_matrices(rows: Float64) -> bool:
    """Return whether rows of 12 or 16 numbers are matrices that turn and move."""
    return bool((rows[:, len(MATRIX) :] == _LAST_ROW[: rows.shape[1] - len(MATRIX)]).all()) and (
        _are_rotations(rows)
    )


def _are_rotations(rows: Float64) -> bool:
    with np.errstate(over="ignore", invalid="ignore"):
        turns = rows[:, _ROTATION].reshape(-1, 3, 3)
        products = turns @ turns.transpose(0, 2, 1)
        near = bool((np.abs(products - np.eye(3)) < _ROUNDED).all())
        return near and bool((np.linalg.det(turns) > 0).all())
