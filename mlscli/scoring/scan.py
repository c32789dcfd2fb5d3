"""A map against a dense scan of the same place: its mesh, and its columns."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from mlscli.errors import InputError, expect
from mlscli.maps.surface_map import SurfaceMap
from mlscli.mesh import build_mesh
from mlscli.runtime.arrays import Array
from mlscli.scoring.columns import ColumnScore, score_columns
from mlscli.scoring.mesh_score import MeshScore, score_mesh
from mlscli.scoring.near import seen_by


@dataclass(frozen=True)
class ScanScore:
    """How right a map is by a scan.

    Attributes
    ----------
    mesh : MeshScore
        How right its mesh is, and what it has found.
    columns : ColumnScore
        Where upright things end, and whether the levels are the same.
    """

    mesh: MeshScore
    columns: ColumnScore

    def to_dict(self) -> dict[str, Any]:
        """Return all fields, ready for JSON."""
        return asdict(self)


def score_scan(
    surface: SurfaceMap,
    scan: Array,
    within: float | None = None,
    *,
    flight: Array | None = None,
    whole: bool = False,
) -> ScanScore:
    """Score a map by a dense scan of the same place.

    Parameters
    ----------
    surface : SurfaceMap
    scan : (N, 3), of any numbers
        The points of the scan, in the map frame and its unit.
    within : float, optional
        The distance at which both agree; by default a cell of the map. A greater one is met more
        easily: maps are compared by scores at the same distance.
    flight : (M, 3), of any numbers, optional
        The points that the map was made of: only what these came near counts, by `seen_by`.
    whole : bool
        Whether all of the mesh is judged, also beside the scan; as for `score_mesh`.

    Returns
    -------
    ScanScore

    Raises
    ------
    UsageError, InputError
        As for `score_mesh`; and where the map holds no patch, or all of it lies beside the scan.
    """
    expect(surface, SurfaceMap, "surface", "a map (SurfaceMap)")
    if not surface.size:
        raise InputError("the map holds no patches")
    within = surface.cell_size if within is None else within
    seen = None if flight is None else seen_by(flight, scan, within)
    mesh = score_mesh(build_mesh(surface), scan, within, seen=seen, whole=whole)
    if mesh.beside == 1:
        raise InputError("the whole map lies beside the scan: are both in one frame?")
    counting = scan if seen is None else scan[seen]
    return ScanScore(mesh, score_columns(surface, counting, within))
