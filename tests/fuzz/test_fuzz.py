"""Hostile input finds nothing in the program, and would find it in others.

How one could cheat: with judges that see nothing, so programs misbehave in every way that counts;
with inputs that are not changed, or of which nothing but a checksum is wrong.
"""

from __future__ import annotations

import json
import re
import struct
import subprocess
import sys
from functools import cache
from pathlib import Path
from random import Random

import pytest

from fuzz.mutation import CHANGES, Change, Material, mutate
from fuzz.packing import parts_of
from fuzz.seeds import MAKERS, READERS, seeds_of
from fuzz.targets import TARGETS
from mlscli.io.reading.formats import open_source
from mlscli.io.writing.npz import read_map
from tests.helpers.examples import EXAMPLES
from tests.helpers.misbehaving import KINDS

ROOT = Path(__file__).resolve().parents[2]
TEXT = b"key: [1.5, 2, -3e4]\nother: {a: 1}\n" * 20
MATERIAL = Material.of([TEXT, bytes(range(256))])


def python(*words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", *words]
    return subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, timeout=300, check=False
    )


@cache
def found() -> dict[str, list[str]]:
    done = python("tests.helpers.misbehaving")
    assert done.returncode == 0, done.stderr
    kinds: dict[str, list[str]] = json.loads(done.stdout)
    return kinds


@pytest.mark.parametrize("program", KINDS, ids=lambda each: each.__name__)
def test_what_no_run_may_do_is_found(program: object) -> None:
    kind, kinds = KINDS[program], found()[program.__name__]  # type: ignore[index, attr-defined]
    assert kind in kinds if kind else kinds == []


def test_a_few_inputs_find_nothing(tmp_path: Path) -> None:
    names = ["mcap", "text", "map-info", "config", "transform"]
    words = ("--targets", ",".join(names), "--seed", "5", "--keep", str(tmp_path / "found"))
    done = python("fuzz", "--inputs", "3", *words)
    assert done.returncode == 0, done.stderr
    rows = [[cell.strip() for cell in row.split("|")[1:-1]] for row in done.stdout.splitlines()]
    assert [row[0] for row in rows[2:-1]] == names
    assert all(row[1] == "3" for row in rows[2:-1])
    assert re.fullmatch(r"[\d,]+", rows[-1][4])
    assert not (tmp_path / "found").exists()


def test_every_target_has_seeds_and_names_them_in_its_commands() -> None:
    assert MAKERS.keys() == TARGETS.keys()
    assert {name for name, _ in READERS.values()} == EXAMPLES.keys(), "READERS in fuzz/seeds.py"
    for target in TARGETS.values():
        assert all(f"in/{target.damaged}" in words for words in target.commands)


@pytest.mark.parametrize("change", CHANGES, ids=lambda each: each.__name__)
def test_a_change_is_made_again_by_the_same_dice_and_changes_most_files(change: Change) -> None:
    made = [change(TEXT, Random(seed), MATERIAL) for seed in range(60)]
    assert made == [change(TEXT, Random(seed), MATERIAL) for seed in range(60)]
    assert len(set(made) - {TEXT}) > 3
    for data in (b"", b"a"):
        for seed in range(60):
            change(data, Random(seed), MATERIAL)


def test_files_do_not_grow_without_end() -> None:
    data = TEXT
    for seed in range(300):
        data = mutate(data, Random(seed), MATERIAL) or TEXT
        assert len(data) < 1 << 19


@pytest.mark.parametrize("target", ["ros1", "mcap", "pcd", "compressed"])
def test_packed_parts_are_packed_again_so_that_they_open(target: str, tmp_path: Path) -> None:
    opened = 0
    for number, seed in enumerate(seeds_of(target, tmp_path / "made")):
        (name,) = (each for each in seed.changed if "yaml" not in each)
        data = seed.files[name]
        for part in parts_of(data):
            path = tmp_path / str(number)
            path.write_bytes(part.packed(part.content))
            source, twin = open_source(path), tmp_path / f"{number}-twin"
            twin.write_bytes(data)
            clouds = [cloud.points.tolist() for cloud in source.clouds()]
            assert clouds == [cloud.points.tolist() for cloud in open_source(twin).clouds()]
            assert [*source.losses] == []
            opened += len(clouds) > 0
    # The cloud, the markers and the scan.
    assert opened > (2 if target == "ros1" else 0)


def test_a_map_of_which_an_array_is_changed_opens_with_the_change(tmp_path: Path) -> None:
    (seed, *_) = seeds_of("map-info", tmp_path / "made")
    parts = parts_of(seed.files["map.npz"])
    (route,) = (part for part in parts if b"(8, 4)" in part.content)
    path = tmp_path / "map.npz"
    path.write_bytes(route.packed(route.content[:-8] + struct.pack("<d", 7.5)))
    assert read_map(path).route[-1, -1] == 7.5
