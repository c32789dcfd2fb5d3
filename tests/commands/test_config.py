"""``mls config`` from outside.

Ways to pass without being right: to write a file that is not the preset, or no configuration, so
what was written is read back; to print what was asked for instead of what is in force, so values
that come from others are looked at; to call everything ok, so faults are counted.
"""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest

from mlscli.config import load, loads, preset_text
from mlscli.pipeline.parameters import to_dict
from tests.helpers.program import mls


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def config(*arguments: str) -> subprocess.CompletedProcess[str]:
    return mls("config", *arguments)


def test_init_writes_the_default_preset_with_its_comments(folder: Path) -> None:
    run = config("init")
    assert (run.returncode, run.stdout) == (0, "")
    assert (folder / "params.yaml").read_text() == preset_text("default")


def test_init_writes_the_preset_asked_for_where_it_is_asked_to(folder: Path) -> None:
    assert config("init", "--preset", "thesis", "-o", "t.yaml").returncode == 0
    assert load(folder / "t.yaml") == load("thesis")
    assert [file.name for file in folder.iterdir()] == ["t.yaml"]


def test_init_prints_where_the_file_is_a_dash(folder: Path) -> None:
    run = config("init", "--preset", "thesis", "-o", "-")
    assert (run.returncode, run.stdout, run.stderr) == (0, preset_text("thesis"), "")
    assert list(folder.iterdir()) == []


def test_a_name_that_is_neither_a_file_nor_a_preset_is_wrong_usage_everywhere(
    folder: Path,
) -> None:
    show, init = config("show", "-c", "thess"), config("init", "--preset", "thess")
    assert show.returncode == init.returncode == 2
    assert "thess: no such configuration file, nor a preset; did you mean thesis?" in show.stderr
    assert list(folder.iterdir()) == []


def test_init_replaces_a_file_only_when_told_to(folder: Path) -> None:
    (folder / "params.yaml").write_text("mine")
    run = config("init")
    assert run.returncode == 1
    assert run.stderr == (
        "mls: params.yaml: exists already; choose another name or add --overwrite\n"
    )
    assert (folder / "params.yaml").read_text() == "mine"
    assert config("init", "--overwrite").returncode == 0
    assert load(folder / "params.yaml") == load("default")


def test_init_of_no_preset_is_told_the_nearest_and_writes_nothing(folder: Path) -> None:
    run = config("init", "--preset", "thess")
    assert run.returncode == 2
    assert run.stderr == "mls: thess: no preset of that name; did you mean thesis?\n"
    assert list(folder.iterdir()) == []


def test_show_prints_what_is_in_force_as_a_configuration(folder: Path) -> None:
    (folder / "p.yaml").write_text("vehicle: {width: 0.3}\n")
    chosen = ["vehicle.height=2 cells", "mode=sequential", "map.gap_size=null"]
    run = config("show", "-c", "p.yaml", *[word for each in chosen for word in ("--set", each)])
    assert (run.returncode, run.stderr) == (0, "")
    assert loads(run.stdout) == load("p.yaml", chosen)
    assert "gap_size: 2 cells\n" in run.stdout
    assert run.stdout.count("max_gap: 0.3\n") == 2


def test_show_prints_json_with_lengths_as_they_are_written(folder: Path) -> None:
    run = config("show", "-c", "thesis", "--json")
    shown = json.loads(run.stdout)
    assert shown == to_dict(load("thesis"))
    assert shown["vehicle"] == {"width": 0.15, "height": 0.5}
    assert shown["pipeline"][1]["orphans"]["horizontal"] == "2 cells"
    assert list(folder.iterdir()) == []


def test_show_reports_every_fault_of_file_and_settings(folder: Path) -> None:
    (folder / "p.yaml").write_text("mode: x\nmap: {thicknes: 1}\n")
    run = config("show", "-c", "p.yaml", "--set", "walls.max_gp=1")
    assert (run.returncode, run.stdout) == (2, "")
    assert run.stderr.splitlines() == [
        "mls: p.yaml:1:7: mode: found 'x'; expected consistent or sequential",
        "mls: p.yaml:2:7: map.thicknes: unknown key; did you mean thickness?",
        "mls: --set walls.max_gp=1: walls.max_gp: unknown key; did you mean max_gap?",
    ]


def test_check_says_ok_for_each_sound_file(folder: Path) -> None:
    (folder / "a.yaml").write_text(preset_text("thesis"))
    (folder / "b.yaml").write_text("")
    run = config("check", "a.yaml", "b.yaml")
    assert (run.returncode, run.stdout, run.stderr) == (0, "", "a.yaml: ok\nb.yaml: ok\n")


def test_check_says_for_which_cells_a_build_would_be_refused(folder: Path) -> None:
    (folder / "a.yaml").write_text("pipeline: [plaster: {max_gap: 0.5, max_gap_enhanced: 2 cells}]")
    run = config("check", "a.yaml", "default")
    assert (run.returncode, run.stdout) == (0, "")
    assert run.stderr.splitlines() == [
        "a.yaml: ok",
        "a.yaml: but not for cells smaller than 0.25: plaster.max_gap_enhanced: 2 cells is less "
        "than max_gap (0.5); at least that, or 0 for none",
        "default: ok",
    ]
    assert config("check", "a.yaml", "--set", "map.cell_size=0.25").stderr == "a.yaml: ok\n"
    run = config("check", "a.yaml", "--set", "map.cell_size=0.2")
    assert (run.returncode, run.stderr.partition(" is less")[0]) == (
        2,
        "mls: a.yaml:1:54: plaster.max_gap_enhanced: 2 cells",
    )


def test_check_reports_the_faults_of_all_files(folder: Path) -> None:
    (folder / "a.yaml").write_text("mode: x\nmap: 3\n")
    (folder / "b.yaml").write_text("")
    (folder / "c.yaml").write_text("pipeline: [medain]\n")
    run = config("check", "a.yaml", "b.yaml", "c.yaml", "missing.yaml")
    assert (run.returncode, run.stdout) == (2, "")
    assert run.stderr.splitlines() == [
        "b.yaml: ok",
        "mls: a.yaml:1:7: mode: found 'x'; expected consistent or sequential",
        "mls: a.yaml:2:6: map: found 3; expected parameters, such as cell_size",
        "mls: c.yaml:1:12: pipeline.medain: unknown stage; did you mean median?",
        "mls: missing.yaml: no such configuration file",
    ]


@pytest.mark.parametrize("words", [("show", "-c"), ("check",)])
def test_a_missing_configuration_is_one_line_and_status_2(folder: Path, words: list[str]) -> None:
    run = config(*words, str(folder / "none.yaml"))
    assert run.returncode == 2
    assert run.stderr == f"mls: {folder / 'none.yaml'}: no such configuration file\n"
