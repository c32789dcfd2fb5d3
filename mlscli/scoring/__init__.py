"""The quality of a map in numbers: against another map, and against the truth.

`compare_maps` matches two maps patch by patch, and `changes` tells what appeared and what went from
one flight to a later one; `score` measures which true surfaces a map has found, and which of its
patches are correct; `score_scan` does so by a dense scan of the same place, and `score_mesh` for
any mesh.
"""

from __future__ import annotations

from mlscli.scoring.changes import Changes, Thing, changes
from mlscli.scoring.columns import ColumnScore, EndErrors, score_columns
from mlscli.scoring.comparison import Comparison, Differences, Spread, compare_maps
from mlscli.scoring.mesh_score import MeshScore, OriginScore, score_mesh
from mlscli.scoring.near import seen_by
from mlscli.scoring.scan import ScanScore, score_scan
from mlscli.scoring.truth import HeightErrors, Measures, Score, Share, score

__all__ = [
    "Changes",
    "ColumnScore",
    "Comparison",
    "Differences",
    "EndErrors",
    "HeightErrors",
    "Measures",
    "MeshScore",
    "OriginScore",
    "ScanScore",
    "Score",
    "Share",
    "Spread",
    "Thing",
    "changes",
    "compare_maps",
    "score",
    "score_columns",
    "score_mesh",
    "score_scan",
    "seen_by",
]
