"""All stages, by their names in a configuration."""

from __future__ import annotations

from mlscli.pipeline.stages.median import Median
from mlscli.pipeline.stages.orphans import Orphans
from mlscli.pipeline.stages.plaster import Plaster
from mlscli.pipeline.stages.pyramids import Pyramids
from mlscli.pipeline.stages.rays import Rays
from mlscli.pipeline.stages.regions import Regions
from mlscli.pipeline.stages.stage import Stage
from mlscli.pipeline.stages.walls import Walls

STAGES: dict[str, type[Stage]] = {
    stage.name: stage for stage in (Rays, Median, Orphans, Walls, Plaster, Pyramids, Regions)
}
