"""What a map is worth, in numbers: against another map, and against the truth.

`compare_maps` matches two maps patch by patch; `score` measures what a map found of the true
surfaces, and how much of what it says is true.
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
