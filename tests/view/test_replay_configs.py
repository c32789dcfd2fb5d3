"""The layout for Lichtblick and the configuration for RViz beside the replay: they show its topics.

How one could cheat: to name topics that no replay has, so names are those that the writer uses.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import yaml

from mlscli.view.replay import FACES, MAP, PATCHES, ROUTE

FOLDER = Path(__file__).resolve().parents[2] / "docs/replay"
TOPICS = {PATCHES, ROUTE, *FACES.values()}


def test_the_layout_shows_the_topics_of_a_replay_in_its_frame() -> None:
    layout = json.loads((FOLDER / "mls.lichtblick.json").read_text(encoding="utf-8"))
    panel = layout["configById"][layout["layout"]]
    assert panel["followTf"] == MAP
    assert panel["topics"].keys() == TOPICS
    assert panel["topics"][PATCHES]["colorField"] == "rgb"


def test_rviz_shows_the_topics_of_a_replay_in_its_frame_also_to_who_comes_late() -> None:
    told = yaml.safe_load((FOLDER / "mls.rviz").read_text(encoding="utf-8"))
    manager: dict[str, Any] = told["Visualization Manager"]
    assert manager["Global Options"]["Fixed Frame"] == MAP
    topics = [display["Topic"] for display in manager["Displays"] if "Topic" in display]
    assert {topic["Value"] for topic in topics} == TOPICS
    assert {topic["Durability Policy"] for topic in topics} == {"Transient Local"}
