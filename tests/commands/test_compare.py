"""`mls compare`, as a user and a script run it.

Ways to pass without being right: an exit status that is 1 for whatever goes wrong, so that a
missing file passes for a difference, or 0 for whatever could be read; options for reading a scan
that are taken and forgotten.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mlscli.io.reading.recording import open_recording
from mlscli.io.writing.npz import read_map, write_map
from mlscli.maps.free_space import FreeSpace
from mlscli.scenes.surfaces import Scene, add_horizontal
from mlscli.scenes.truth import truth
from mlscli.scoring import compare_maps, score, score_scan
from tests.helpers.maps import CELL, GAP, Patch, map_of
from tests.helpers.program import mls

FLOOR = [Patch(x, y, 0.0, 0.0, 0, 3) for x in range(4) for y in range(3)]
DECK = [Patch(x, 1, 2.0, 0.0, 2, 0) for x in range(4)]
LIFTED = [patch._replace(height=patch.height + 0.125) for patch in FLOOR]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder of maps: a bridge, one like it, its floor, and a floor a bit higher."""
    write_map(tmp_path / "bridge.npz", map_of(FLOOR + DECK))
    write_map(tmp_path / "same.npz", replace(map_of(FLOOR + DECK), meta={"sources": ["other"]}))
    write_map(tmp_path / "floor.npz", map_of(FLOOR))
    write_map(tmp_path / "lifted.npz", map_of(LIFTED))
    write_map(tmp_path / "coarse.npz", map_of(FLOOR, cell_size=0.8))
    write_map(tmp_path / "odd.npz", replace(map_of(FLOOR), meta={"reading": {"colour": 1}}))
    (tmp_path / "broken.npz").write_bytes(b"PK no archive")
    scan = np.stack(np.meshgrid(*[np.arange(0.05, n * CELL, 0.1) for n in (4, 3)], [0.0]), axis=-1)
    np.savetxt(tmp_path / "scan.xyz", scan.reshape(-1, 3), fmt="%.6f")
    np.savetxt(tmp_path / "far.xyz", scan.reshape(-1, 3) + 1e4, fmt="%.6f")
    return tmp_path


def test_maps_that_do_not_differ_end_with_0(folder: Path) -> None:
    done = mls("compare", "bridge.npz", "same.npz", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[:2] == [
        "bridge.npz and same.npz: identical",
        "  patches     16 matched",
    ]
    assert done.stderr == ""


def test_maps_that_differ_end_with_1_and_the_report_says_how(folder: Path) -> None:
    done = mls("compare", "bridge.npz", "lifted.npz", cwd=folder)
    assert done.returncode == 1
    assert done.stderr == ""
    lines = done.stdout.splitlines()
    assert lines[0] == "bridge.npz and lifted.npz: differ"
    assert "  patches     12 matched, 4 only in bridge.npz" in lines
    assert (
        "  heights     rmse 0.125, median 0.125, 95 % 0.125, maximum 0.125; "
        "12 differ by more than 0" in lines
    )
    assert "  columns     differ in height of 12, top of 12, bottom of 12, mean of 12" in lines
    assert "  artificial  4 only in bridge.npz" in lines


@pytest.mark.parametrize(("tolerance", "status"), [("0.125", 0), ("0.124", 1), ("0", 1)])
def test_the_tolerance_decides_what_passes_for_equal(
    folder: Path, tolerance: str, status: int
) -> None:
    done = mls("compare", "floor.npz", "lifted.npz", "--tolerance", tolerance, cwd=folder)
    assert done.returncode == status, done.stderr
    assert ("equal within 0.125" in done.stdout) == (status == 0)


def test_no_tolerance_lets_a_patch_go_missing(folder: Path) -> None:
    assert mls("compare", "floor.npz", "bridge.npz", "--tolerance", 99, cwd=folder).returncode == 1


def test_a_comparison_as_json_is_what_the_library_says(folder: Path) -> None:
    done = mls("compare", "bridge.npz", "lifted.npz", "--tolerance", "0.1", "--json", cwd=folder)
    assert done.returncode == 1
    a, b = (read_map(folder / name) for name in ("bridge.npz", "lifted.npz"))
    expected = {"a": "bridge.npz", "b": "lifted.npz", **compare_maps(a, b, 0.1).to_dict()}
    assert json.loads(done.stdout) == expected


def test_against_the_truth_the_report_tells_every_measure(folder: Path) -> None:
    write_map(folder / "flight.npz", map_of(LIFTED[1:] + DECK))
    done = mls("compare", "flight.npz", "--truth", "floor.npz", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [
        "flight.npz against floor.npz",
        "  completeness          91.67 %: 11 of 12 true patches found; "
        "horizontal 91.67 %, vertical -",
        "  correctness           73.33 %: 11 of 15 patches on a true surface",
        "  heights               rmse 0.125, bias 0.125, 95 % 0.125 in 11 patches",
        "  false levels          4, 0.333333 for each true cell",
        "  levels missed         1",
        "  phantom closings      100.00 %: 4 of 4 inserted patches",
        "  their places          4 elsewhere",
        "  honest red            0.00 %: 0 of 4 artificial patches on a true surface",
        "  flat called vertical  0.00 %: 0 of 12 flat true patches",
        "  measured              91.67 % found by these alone, 100.00 % correct; "
        "heights rmse 0.125, bias 0.125, 95 % 0.125 in 11 patches",
        "  artificial            0.00 % found by these alone, 0.00 % correct; "
        "heights none to compare",
    ]


def test_against_the_truth_the_report_says_where_phantom_closings_are(folder: Path) -> None:
    walls = [Patch(x, 9, z, 1.0, 0, 1) for x in (3, 4, 8) for z in (1.0, 4.0)]
    ledges = [Patch(x, y, 0.0, 0.0, 0, 1) for x, y in ((3, 6), (8, 6), (6, 3), (6, 9))]
    windows = [Patch(x, 9, 2.0, 0.0, 2, 0) for x in (3, 4)]
    hole, too_high = Patch(6, 6, 0.0, 0.0, 2, 0), Patch(3, 2, 0.4, 0.0, 1, 0)
    passage = [Patch(x, 1, 1.0, 0.0, 2, 0) for x in range(3)]
    write_map(folder / "flight.npz", map_of([hole, too_high, *windows, *passage]))
    write_map(folder / "town.npz", map_of(FLOOR + DECK + walls + ledges))
    done = mls("compare", "flight.npz", "--truth", "town.npz", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "  phantom closings      100.00 %: 7 of 7 inserted patches" in done.stdout
    assert (
        "  their places          3 under a deck, 2 in a window, 1 in a hole of the ground, "
        "1 off their level\n" in done.stdout
    )


def test_a_truth_that_knows_its_surfaces_is_made_anew_on_the_grid_of_the_map(folder: Path) -> None:
    plain = add_horizontal(Scene("plain"), (1.0, 0.75, 0.0), (2.0, 1.5))
    for cell_size, gap_size, thickness in ((0.3, GAP, 0.25), (CELL, 9.0, 0.25), (CELL, GAP, 0.1)):
        surfaces = truth(plain, cell_size, gap_size, thickness)
        write_map(folder / "plain.truth.npz", surfaces, overwrite=True)
        done = mls("compare", "floor.npz", "--truth", "plain.truth.npz", cwd=folder)
        assert done.returncode == 0, done.stderr
        assert "completeness          100.00 %: 12 of 12 true patches" in done.stdout
        assert "correctness           100.00 %: 12 of 12 patches" in done.stdout


def test_the_thickness_of_the_map_says_what_in_the_truth_is_a_wall(folder: Path) -> None:
    # It rises by half a unit within a cell: no patch of thickness 0.25, one of thickness 1.
    slope = add_horizontal(Scene("slope"), (1.0, 0.75, 0.0), (2.0, 1.5), grade=1.0)
    write_map(folder / "slope.truth.npz", truth(slope, CELL, GAP, 1.0))
    done = mls("compare", "floor.npz", "--truth", "slope.truth.npz", "--json", cwd=folder)
    told = json.loads(done.stdout)["total"]
    assert told["completeness_horizontal"]["of"] == 0
    assert told["completeness_vertical"]["of"] == 12


def test_a_truth_whose_surfaces_cannot_be_read_is_named(folder: Path) -> None:
    for scene in (3, {"name": "x", "surfaces": [[1, 2]]}, None):
        write_map(
            folder / "odd.npz",
            replace(map_of(FLOOR, gap_size=3.0), meta={"scene": scene}),
            overwrite=True,
        )
        done = mls("compare", "floor.npz", "--truth", "odd.npz", cwd=folder)
        assert done.returncode == 2
        assert done.stderr.startswith("mls: odd.npz: meta: holds no scene")
        assert done.stderr.count("\n") == 1


def test_a_score_as_json_is_what_the_library_says(folder: Path) -> None:
    done = mls("compare", "lifted.npz", "--truth", "bridge.npz", "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    surface, bridge = (read_map(folder / name) for name in ("lifted.npz", "bridge.npz"))
    expected = {"map": "lifted.npz", "truth": "bridge.npz", **score(surface, bridge).to_dict()}
    assert json.loads(done.stdout) == expected


# --- a scan ---


def test_a_map_is_scored_by_a_scan(folder: Path) -> None:
    done = mls("compare", "bridge.npz", "--cloud", "scan.xyz", cwd=folder)
    assert done.returncode == 0, done.stderr
    # The floor, 3 by 2 cells between the outer centres; the deck, squares of half a cell alone.
    assert done.stdout.splitlines() == [
        "bridge.npz against scan.xyz",
        "  within      0.5",
        "  precision   85.71 % of the mesh is near the scan",
        "  recall      100.00 % of the scan is near the mesh",
        "  F-score     92.31 %",
        "  points      300 count; 100.00 % near",
        "  measured    85.71 % of the mesh, 100.00 % of it right; without it precision -85.71, "
        "recall -100.00",
        "  artificial  14.29 % of the mesh, 0.00 % of it right; without it precision +14.29, "
        "recall +0.00",
        "  levels      agree in 66.67 %: 8 of 12 cells",
    ]
    assert done.stderr == ""


def test_a_score_by_a_scan_as_json_is_what_the_library_says(folder: Path) -> None:
    options = ("--cloud", "scan.xyz", "--within", "0.2", "--flight", "scan.xyz")
    done = mls("compare", "lifted.npz", *options, "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    (keyframe,) = open_recording(folder / "scan.xyz").keyframes()
    result = score_scan(read_map(folder / "lifted.npz"), keyframe.points, 0.2)
    files = {"map": "lifted.npz", "cloud": ["scan.xyz"], "flight": ["scan.xyz"]}
    assert json.loads(done.stdout) == {**files, **result.to_dict(), "lost": []}
    assert 0 < result.mesh.f < 1


def test_a_scan_is_read_as_the_options_say_and_a_flight_as_that_of_the_map(folder: Path) -> None:
    scan = np.loadtxt(folder / "scan.xyz")
    # x, y, z as of a camera: to the right, down, ahead.
    camera = np.column_stack((scan[:, 0], -scan[:, 2], scan[:, 1]))
    np.savetxt(folder / "camera.xyz", camera[camera[:, 0] < 1], fmt="%.6f")
    np.savetxt(folder / "rest.xyz", camera[camera[:, 0] > 1], fmt="%.6f")
    built = replace(read_map(folder / "floor.npz"), meta={"reading": {"up": "-y"}})
    write_map(folder / "built.npz", built)
    both = ("--cloud", "camera.xyz", "--cloud", "rest.xyz", "--up", "-y")
    told = []
    for flight in ((), ("--flight", "camera.xyz")):
        done = mls("compare", "built.npz", *both, *flight, "--within", "0.1", "--json", cwd=folder)
        assert done.returncode == 0, done.stderr
        told.append(json.loads(done.stdout)["mesh"])
    assert (told[0]["points"], told[0]["unseen"]) == (300, 0)
    # Half of it, and three tenths more.
    assert (told[1]["points"], told[1]["unseen"]) == (195, pytest.approx(0.35))
    assert told[0]["precision"] == told[1]["precision"] == 1


def test_what_the_scan_or_the_flight_has_lost_is_told(folder: Path) -> None:
    lines = (folder / "scan.xyz").read_text(encoding="utf-8").splitlines(keepends=True)
    header = "".join(f"property float {axis}\n" for axis in "xyz")
    header = f"ply\nformat ascii 1.0\nelement vertex {len(lines)}\n{header}end_header\n"
    (folder / "cut.ply").write_text(header + "".join(lines[:-9]), encoding="utf-8")
    for options in (("--cloud", "cut.ply"), ("--cloud", "scan.xyz", "--flight", "cut.ply")):
        done = mls("compare", "floor.npz", *options, "--json", cwd=folder)
        assert done.returncode == 3, done.stderr
        (lost,) = json.loads(done.stdout)["lost"]
        assert "cut.ply" in lost
        assert f"mls: warning: {lost}\n" == done.stderr


# --- what cannot be compared ---


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ("floor.npz missing.npz", "mls: missing.npz: no such file"),
        ("missing.npz floor.npz", "mls: missing.npz: no such file"),
        ("floor.npz --truth missing.npz", "mls: missing.npz: no such file"),
        ("broken.npz floor.npz", "mls: broken.npz: is no map (.npz), or a damaged one"),
        ("floor.npz", "mls: B: name either a second map, or the truth with --truth T, or a scan"),
        ("floor.npz floor.npz --truth floor.npz", "mls: B: name either a second map, or"),
        ("floor.npz --truth floor.npz --tolerance 1", "mls: --tolerance: goes with two maps"),
        ("floor.npz coarse.npz", "mls: floor.npz and coarse.npz: cell_size: is 0.5 in one map"),
        ("floor.npz --truth coarse.npz", "mls: floor.npz and coarse.npz: cell_size: is 0.5"),
        ("floor.npz floor.npz --tolerance -1", "tolerance: is -1.0; it must be a number"),
        ("floor.npz floor.npz --tolerance nan", "tolerance: is nan; it must be a number"),
        ("floor.npz floor.npz --tolerance x", "mls compare: Invalid value for '--tolerance'"),
        (
            "floor.npz --cloud scan.xyz --flight missing.xyz",
            "mls: missing.xyz: there is no such file",
        ),
        ("floor.npz floor.npz --cloud scan.xyz", "mls: B: name either a second map, or"),
        ("floor.npz --cloud scan.xyz --tolerance 1", "mls: --tolerance: goes with two maps; with"),
        ("floor.npz --truth floor.npz --up y", "mls: --up: goes with --cloud SCAN"),
        ("floor.npz floor.npz --every 1", "mls: --every: goes with --cloud SCAN"),
        (
            "floor.npz --cloud scan.xyz --within 0",
            "scan.xyz: --within 0.0: expected a number above",
        ),
        (
            "floor.npz --cloud far.xyz",
            "floor.npz and far.xyz: the whole map lies beside the scan: ",
        ),
        (
            "floor.npz --cloud scan.xyz --flight far.xyz",
            "floor.npz and scan.xyz: no point of the scan counts: the flight came near none",
        ),
        ("odd.npz --cloud scan.xyz --flight scan.xyz", "mls: odd.npz: meta: its key reading does"),
    ],
)
def test_what_cannot_be_compared_ends_with_2_and_one_line(
    folder: Path, arguments: str, complaint: str
) -> None:
    done = mls("compare", *arguments.split(), cwd=folder)
    assert done.returncode == 2
    assert done.stdout == ""
    assert complaint in done.stderr
    assert done.stderr.count("\n") == 1


def test_what_went_is_told_where_it_was(tmp_path: Path) -> None:
    tall = [Patch(x, y, 3.0, 3.0, 0, 9) for x in (1, 2) for y in (1, 2)]
    space = FreeSpace(
        np.repeat(np.arange(4, dtype=np.int32), 3), np.tile(np.arange(3, dtype=np.int32), 4),
        12 * np.arange(13), np.tile(np.arange(1, 13, dtype=np.int32), 12),
        np.full(144, 3, dtype=np.uint8),
    )  # fmt: skip
    rest = [patch for patch in FLOOR if patch.cell not in {tower.cell for tower in tall}]
    write_map(tmp_path / "a.npz", replace(map_of(rest + tall), free=space))
    write_map(tmp_path / "b.npz", replace(map_of(FLOOR), free=space))
    write_map(tmp_path / "blind.npz", map_of(FLOOR))
    done = mls("compare", "a.npz", "b.npz", "--changed", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (1, "")
    assert done.stdout.splitlines() == [
        "a.npz to b.npz: changed",
        "  gone  x 0.500 to 1.500; y 0.500 to 1.500; z 0.500 to 3.250",
    ]
    told = json.loads(mls("compare", "b.npz", "a.npz", "--changed", "--json", cwd=tmp_path).stdout)
    assert [thing["high"] for thing in told["appeared"]] == [[1.5, 1.5, 3.25]]
    same = mls("compare", "a.npz", "a.npz", "--changed", cwd=tmp_path)
    assert same.returncode == 0
    assert same.stdout == "a.npz to a.npz: nothing appeared or went where both looked\n"
    blind = mls("compare", "a.npz", "blind.npz", "--changed", cwd=tmp_path)
    assert blind.returncode == 2
    assert "the second map does not say what was seen through" in blind.stderr
    assert mls("compare", "a.npz", "--changed", cwd=tmp_path).returncode == 2
