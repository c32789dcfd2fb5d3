"""Results as text fit a terminal of 80 columns.

How one could cheat: to cut what does not fit, so the words are compared; to break lines in pipes,
too, where a row stays a line.
"""

from __future__ import annotations

import os
import shutil
import sys

import pytest

from mlscli.commands import report
from mlscli.commands.topics import lines

VIEWS = [
    ("view", "at", "yaw", "way down", "sees"),
    ("1", "-2.006,2.984,2.738", "-90", "high", "1,179 artificial, 35 unseen, 24 edge"),
    ("12", "3.120,1.440,3.596", "0", "never seen", "67 edge"),
]


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)
    monkeypatch.setattr(shutil, "get_terminal_size", lambda: os.terminal_size((80, 24)))


def test_in_a_pipe_a_row_of_a_table_is_a_line() -> None:
    assert report.table(VIEWS, right=[2]).splitlines() == [
        "  view  at                  yaw  way down    sees",
        "  1     -2.006,2.984,2.738  -90  high        1,179 artificial, 35 unseen, 24 edge",
        "  12    3.120,1.440,3.596     0  never seen  67 edge",
    ]


@pytest.mark.usefixtures("terminal")
def test_on_a_terminal_the_last_column_goes_on_below_itself() -> None:
    head, first, more, second = report.table(VIEWS).splitlines()
    assert max(map(len, (head, first, more, second))) <= 80
    at = head.index("sees")
    assert more[:at].isspace()
    assert f"{first[at:]} {more[at:]}" == VIEWS[1][-1]
    assert second.endswith("67 edge")


@pytest.mark.usefixtures("terminal")
def test_topics_fit_a_terminal() -> None:
    topic = {"name": "/camera/depth/points", "type": "sensor_msgs/msg/PointCloud2", "messages": 9}
    why = "no transform leads from 'camera' to a frame that stands still; name one by --frame"
    told = {"use": "clouds", "mappable": False, "why_not": why}
    text = "\n".join(lines({"topics": [topic | told], "frames": []}))
    assert max(map(len, text.splitlines())) <= 80
    assert why in " ".join(text.split())


def test_many_levels_fit_a_line() -> None:
    shown = report.levels({str(n): 1000 for n in range(1, 21)})
    assert shown.endswith(", 15,000 cells with 6 to 20")
    assert shown.count(",000 cells with") == 6
