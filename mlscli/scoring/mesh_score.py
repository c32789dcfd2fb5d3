"""A mesh against a dense scan of the same place: how much of it is right, and what it has found.

Precision, recall and F-score at a distance are those of Knapitsch et al., Tanks and Temples, 2017,
doi:10.1145/3072959.3073599: the share of the mesh that is within the distance of the scan, the
share of the scan that is within it of the mesh, and their harmonic mean. As there, neither may
depend on how densely something was sampled:

- The mesh counts by its area. Each triangle is cut into pieces of no more than a quarter of the
  distance, and each piece counts with its area where its centroid is near a point of the scan. So
  no random number decides, and the order of the triangles makes no difference.
- The scan counts by the cubes of half the distance that hold points: what a scanner saw from close
  by counts no more than what it saw from afar. A cube counts with the share of its points that are
  near the mesh; their distance to the triangles is exact.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from mlscli.errors import InputError, UsageError, expect
from mlscli.maps.surface_map import ORIGINS
from mlscli.mesh import Mesh
from mlscli.runtime.arrays import Array, Bool, Float64
from mlscli.runtime.kernels import inner, kernel
from mlscli.runtime.threads import in_ranges
from mlscli.scoring.near import (
    PointColumns,
    box_around,
    checked_scan,
    first_within,
    is_near,
    near_triangles,
)

# How far beside the scan a mesh is judged, in distances.
BESIDE = 3

_PIECES = 4  # of a triangle to a distance
_MOST_PIECES = 10**10


@dataclass(frozen=True)
class OriginScore:
    """What the triangles of one origin do for the score.

    A triangle has the origin of its corners, the last in `ORIGINS` where they differ.

    Attributes
    ----------
    share : float
        Their share of the area that is judged.
    precision : float or None
        The share of their own area that is near the scan; None where they have none.
    precision_lost, recall_won : float
        How much higher the precision, and lower the recall, of the mesh would be without them.
    """

    share: float
    precision: float | None
    precision_lost: float
    recall_won: float


@dataclass(frozen=True)
class MeshScore:
    """How well a mesh and a scan agree at a distance; shares are 0 to 1.

    Attributes
    ----------
    within : float
        The distance, in the unit of the scan.
    area : float
        The area of the mesh that is judged, in the squared unit.
    beside : float
        The share of the mesh that is not, as no point of the scan is near enough to judge it.
    points : int
        The points of the scan that count.
    unseen : float
        The share of the scan's points that do not count, as the flight did not come near them.
    precision, recall : float
        Shares of the mesh near the scan, and of the scan near the mesh; of nothing, 0.
    f : float
        Their harmonic mean.
    points_found : float
        The share of the points that count that are near the mesh. It is the recall where the scan
        is equally dense everywhere.
    by_origin : mapping of str to OriginScore
        What measured, plastered and artificial triangles do for it.
    """

    within: float
    area: float
    beside: float
    points: int
    unseen: float
    precision: float
    recall: float
    f: float
    points_found: float
    by_origin: Mapping[str, OriginScore]

    def to_dict(self) -> dict[str, Any]:
        """Return all fields, ready for JSON."""
        return asdict(self)


def score_mesh(
    mesh: Mesh, scan: Array, within: float, *, seen: Bool | None = None, whole: bool = False
) -> MeshScore:
    """Score a mesh by a dense scan of the same place.

    What counts is the whole scan, so that a mesh that has lost a part of the scene shows it; where
    a scan reaches farther than the flight did, `seen_by` says which of its points count. Of the
    mesh, what lies beside the scan is left out, and told: where nothing was scanned, nothing can be
    judged.

    Parameters
    ----------
    mesh : Mesh
    scan : (N, 3), of any numbers
        The points of the scan, in the frame and unit of the mesh.
    within : float
        The distance, above 0, in the same unit. A greater one is met more easily: meshes are
        compared by scores at the same distance.
    seen : bool (N,), optional
        Which points of the scan count; by default all. The mesh is right near any of them.
    whole : bool
        Whether all of the mesh is judged. Otherwise triangles, or parts of them, are left out where
        no column of half the distance within six, in x and in y, holds a point of the scan.

    Returns
    -------
    MeshScore

    Raises
    ------
    UsageError
        Where the distance is not above 0, or too small to work with, or an array is none of points.
    InputError
        Where the scan holds no points, or none that count.
    """
    expect(mesh, Mesh, "mesh", "a mesh (Mesh)")
    scan = checked_scan(scan, within)
    if seen is not None:
        seen = _checked_mask(seen, len(scan))
    columns = PointColumns.of(scan, within / 2)
    corners = np.ascontiguousarray(mesh.vertices[mesh.triangles])
    origin = mesh.group(mesh.triangles)
    judged, right, total = _areas(corners, columns, within, whole=whole)
    if seen is not None:
        columns = PointColumns.of(scan[seen], within / 2)
    near = near_triangles(columns, corners, origin, len(ORIGINS), within)
    found, *found_without = _recall(columns, near).tolist()
    of_origin = [origin == number for number in range(len(ORIGINS))]
    area, precision = _sum(judged), _share(right, judged)
    return MeshScore(
        within=float(within),
        area=area,
        beside=_ratio(_sum(total - judged), _sum(total)),
        points=len(columns.xyz),
        unseen=1 - len(columns.xyz) / len(scan),
        precision=precision,
        recall=found,
        f=_ratio(2 * precision * found, precision + found),
        points_found=float(near.any(axis=0).mean()),
        by_origin={
            name: OriginScore(
                share=_ratio(_sum(judged[own]), area),
                precision=_share(right[own], judged[own]) if _sum(judged[own]) else None,
                precision_lost=_share(right[~own], judged[~own]) - precision,
                recall_won=found - without,
            )
            for name, own, without in zip(ORIGINS, of_origin, found_without, strict=True)
        },
    )


def _checked_mask(seen: Bool, size: int) -> Bool:
    expected = f"a mask as an array of bool ({size},)"
    expect(seen, np.ndarray, "seen", expected)
    if seen.shape != (size,) or seen.dtype != np.bool_:
        raise UsageError(
            f"`seen`: has shape {seen.shape} and dtype {seen.dtype}; expected {expected}"
        )
    if not seen.any():
        raise InputError("no point of the scan counts: the flight came near none of them")
    return seen


def _areas(
    corners: Float64, scan: PointColumns, within: float, *, whole: bool
) -> tuple[Float64, Float64, Float64]:
    """Return the area of each triangle that is judged, that is right, and all, float64 (T,)."""
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    longest, shortest = sides.max(axis=1, initial=0), sides.min(axis=1, initial=math.inf)
    with np.errstate(over="ignore"):
        pieces = _sum(np.ceil(_PIECES * longest / within) * np.ceil(_PIECES * shortest / within))
    if not pieces <= _MOST_PIECES:
        raise UsageError(
            f"`within` {within:g}: too small for this mesh, which would be cut into {pieces:.2g} "
            f"pieces; at most {_MOST_PIECES:.0e} can be looked at"
        )
    shares = np.empty((len(corners), 2))
    in_ranges(
        len(corners),
        lambda begin, end: _judge(
            corners[begin:end], within / _PIECES, scan, within, whole, shares[begin:end]
        ),
    )
    a, b, c = np.moveaxis(corners, 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    return area * shares[:, 0], area * shares[:, 1], area


@kernel
def _judge(
    corners: Float64,
    spacing: float,
    scan: PointColumns,
    within: float,
    whole: bool,
    shares: Float64,
) -> None:
    """Compute which shares of the area of triangles are judged, and right.

    Lines from the corner that faces the shortest edge, and lines along this edge, cut a triangle
    into pieces that are no wider, nor longer, than the spacing.

    Parameters
    ----------
    corners : float64 (T, 3, 3)
        The corners of the triangles.
    spacing : float
        The greatest length and width of a piece.
    scan : PointColumns
        Columns of half the distance.
    within : float
        A piece is right where a point of the scan is no farther from its centroid.
    whole : bool
        Whether pieces are judged that lie beside the scan.
    shares : float64 (T, 2)
        Receives the shares that are judged, and right.
    """
    for t in range(len(corners)):
        first, shortest, longest = 0, np.inf, 0.0
        for k in range(3):
            length = _distance(corners[t, (k + 1) % 3], corners[t, (k + 2) % 3])
            longest = max(longest, length)
            if length < shortest:
                first, shortest = k, length
        a, b, c = corners[t, first], corners[t, (first + 1) % 3], corners[t, (first + 2) % 3]
        rows = max(1, int(np.ceil(longest / spacing)))
        columns = max(1, int(np.ceil(shortest / spacing)))
        judged = right = 0
        for row in range(rows):
            # The pieces of a row are alike. Their area grows as the odd numbers.
            weight = 2 * row + 1
            down = (row + 0.5 + 1 / (6 * weight)) / rows
            for column in range(columns):
                across = (column + 0.5) / columns
                x = a[0] + down * (b[0] - a[0] + across * (c[0] - b[0]))
                y = a[1] + down * (b[1] - a[1] + across * (c[1] - b[1]))
                z = a[2] + down * (b[2] - a[2] + across * (c[2] - b[2]))
                is_right = is_near(x, y, z, scan, within)
                if is_right or whole or _is_below_or_above(x, y, scan, within):
                    judged += weight
                if is_right:
                    right += weight
        shares[t, 0], shares[t, 1] = judged / (rows**2 * columns), right / (rows**2 * columns)


@inner
def _distance(one: Float64, other: Float64) -> float:
    x, y, z = one[0] - other[0], one[1] - other[1], one[2] - other[2]
    return float(np.sqrt(x * x + y * y + z * z))


@inner
def _is_below_or_above(x: float, y: float, scan: PointColumns, within: float) -> bool:
    """Return whether the scan has points near a place in x and y, whatever their height."""
    box = box_around(x, x, y, y, BESIDE * within, scan.side)
    return first_within(scan.keys, 0, box) < len(scan.keys)


@kernel
def _recall(scan: PointColumns, near: Bool) -> Float64:
    """Return the recall, and what it is without each group, float64 (1 + G,).

    Parameters
    ----------
    scan : PointColumns
        Columns of half the distance; a cube is as high.
    near : bool (G, N)
        Which points are near the triangles of each group.
    """
    shares = np.zeros(1 + len(near))
    counts = np.zeros(1 + len(near), dtype=np.int64)
    cubes = begin = 0
    for column in range(len(scan.keys)):
        for i in range(scan.start[column], scan.start[column + 1]):
            groups = near[:, i].sum()
            counts[0] += groups > 0
            for group in range(len(near)):
                counts[1 + group] += groups > near[group, i]
            is_last = i + 1 == scan.start[column + 1]
            if is_last or _level(scan, i) != _level(scan, i + 1):
                shares += counts / (i + 1 - begin)
                counts[:] = 0
                cubes, begin = cubes + 1, i + 1
    return shares / cubes


@inner
def _level(scan: PointColumns, i: int) -> float:
    return float(np.floor(scan.xyz[i, 2] / scan.side))


def _share(part: Float64, of: Float64) -> float:
    return _ratio(_sum(part), _sum(of))


def _ratio(part: float, of: float) -> float:
    return part / of if of else 0.0


def _sum(values: Float64) -> float:
    """Return the sum, which does not depend on the order."""
    return math.fsum(values.tolist())
