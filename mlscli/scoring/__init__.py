"""The quality of a map in numbers: against another map, and against the truth.

`compare_maps` matches two maps patch by patch; `score` measures which true surfaces a map has
found, and which of its patches are correct.
"""

from __future__ import annotations

from mlscli.scoring.comparison import Comparison, Differences, Spread, compare_maps
from mlscli.scoring.truth import HeightErrors, Measures, Score, Share, score

__all__ = [
    "Comparison",
    "Differences",
    "HeightErrors",
    "Measures",
    "Score",
    "Share",
    "Spread",
    "compare_maps",
    "score",
]
