"""The stages there are, by the name that a configuration calls them."""

from __future__ import annotations

from mlscli.pipeline.median import Median
from mlscli.pipeline.orphans import Orphans
from mlscli.pipeline.plaster import Plaster
from mlscli.pipeline.pyramids import Pyramids
from mlscli.pipeline.regions import Regions
from mlscli.pipeline.stage import Stage
from mlscli.pipeline.walls import Walls

STAGES: dict[str, type[Stage]] = {
    stage.name: stage for stage in (Median, Orphans, Walls, Plaster, Pyramids, Regions)
}
