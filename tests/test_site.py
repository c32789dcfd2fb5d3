"""The site is made without a warning, and has a place for every command, parameter and name.

How one could cheat: a reference that names what its own list has, so it is held against the
program; a page that is in no chapter, of which Sphinx warns, as of links that lead nowhere.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import mlscli
from mlscli.cli import COMMANDS
from mlscli.config import load
from mlscli.pipeline.parameters import to_dict

pytest.importorskip("sphinx")
pytest.importorskip("furo")

ROOT = Path(__file__).resolve().parent.parent


def test_the_site_has_a_place_for_everything(tmp_path: Path) -> None:
    make = [sys.executable, "-m", "docs.site.build", str(tmp_path)]
    done = subprocess.run(make, cwd=ROOT, capture_output=True, text=True, timeout=300, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    told = {
        page: (tmp_path / f"reference/{page}.html").read_text(encoding="utf-8")
        for page in ("commands", "parameters", "python")
    }
    assert all(f"mls {name}" in told["commands"] for name in COMMANDS)
    assert "mls config check" in told["commands"]
    assert "--pose-topic" in told["commands"]
    stages = to_dict(load("default"))["pipeline"]
    assert all(
        f"{s}.{name}<" in told["parameters"] for stage in stages for s in stage for name in stage[s]
    )
    # The notebook was run: no cell failed, and what its cells show stands in the page.
    notebook = (tmp_path / "docs/first-hour-python.html").read_text(encoding="utf-8")
    assert 'src="data:image/png;base64,' in notebook
    assert notebook.count('alt="What the cell shows"') == 1
    for verdict in ("1.8 does not fit", "0.4 fits", "1.0 never seen"):
        assert verdict in notebook
    names = [name for name in mlscli.__all__ if not name.startswith("__")]
    assert all(f'id="mlscli.{name}"' in told["python"] for name in names)
