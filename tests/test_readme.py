"""What the README shows is what the program does."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import numpy as np

import mlscli
from tests.helpers.bags import Sent, write_bag
from tests.helpers.program import mls

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_summary_shown_is_the_summary_printed(tmp_path: Path) -> None:
    done = mls("build", ROOT / "data/samples/bridge.txt", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    shown = README.partition("$ mls build data/samples/bridge.txt\n")[2].partition("      ...")[0]
    assert len(shown.splitlines()) == 5
    for line in shown.splitlines():
        assert line.strip() in done.stdout


def test_the_comparisons_shown_are_those_printed(tmp_path: Path) -> None:
    recording = mlscli.open_recording(ROOT / "data/samples/bridge.txt")
    for prefix, mode in (("", "consistent"), ("s", "sequential")):
        for size in (80, 300):
            sets = [f"mode={mode}", f"batch.min_points={size}"]
            surface = mlscli.build_map(recording, mlscli.load_parameters(None, sets))
            mlscli.write_map(tmp_path / f"{prefix}{size}.npz", surface)
        compared = (f"{prefix}80.npz", f"{prefix}300.npz")
        shown = README.partition(f"$ mls compare {' '.join(compared)}\n")[2].partition("  ...")[0]
        printed = mls("compare", *compared, cwd=tmp_path).stdout
        assert len(shown.splitlines()) > 2
        for line in shown.splitlines():
            assert line.strip() in printed


def test_the_python_shown_runs(tmp_path: Path) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    rng = np.random.default_rng(1)
    clouds = [Sent(rng.uniform(0, 5, (500, 3)) * (1, 1, 0.01)) for _ in range(3)]
    write_bag(tmp_path / "flight.bag", clouds)
    (tmp_path / "params.yaml").write_text("mode: consistent\n")
    for name in ("flight.bag", "params.yaml", "flight.npz", "flight.ply"):
        assert f'"{name}"' in code
        code = code.replace(f'"{name}"', repr(str(tmp_path / name)))
    script = tmp_path / "shown.py"
    script.write_text(code)
    assert runpy.run_path(str(script))["surface"].size > 0
    assert (tmp_path / "flight.ply").stat().st_size > 0


def test_the_documents_named_exist() -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        assert (ROOT / target).exists(), target
