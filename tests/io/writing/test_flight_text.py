"""Text recordings: what is written reads back as the same bits.

Ways to pass without being right: numbers so round that any format holds them.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import mlscli
from mlscli.errors import OutputError
from mlscli.io.writing.flight_text import write_text
from mlscli.keyframes.keyframe import Keyframe


def flight() -> list[Keyframe]:
    rng = np.random.default_rng(9)
    return [
        Keyframe(
            rng.normal(0, 10.0**exponent, (int(rng.integers(1, 30)), 3)),
            1_700_000_000.0 + rng.random(),
            tuple(rng.normal(size=3).tolist()),
        )
        for exponent in range(-6, 7)
    ]


def same(one: Keyframe, other: Keyframe) -> bool:
    return (
        one.points.tobytes() == other.points.tobytes()
        and np.array(one.stamp).tobytes() == np.array(other.stamp).tobytes()
        and np.array(one.position).tobytes() == np.array(other.position).tobytes()
    )


@pytest.mark.parametrize("name", ["a.txt", "a.csv", "a.xyz"])
def test_a_text_recording_reads_back_bit_for_bit(tmp_path: Path, name: str) -> None:
    write_text(tmp_path / name, flight())
    found = list(mlscli.open_recording(tmp_path / name).keyframes())
    assert len(found) == 13
    assert all(map(same, found, flight()))


def test_commas_part_the_columns_of_csv_only(tmp_path: Path) -> None:
    for name, header in (
        ("a.csv", "x,y,z,keyframe,t,cx,cy,cz"),
        ("a.txt", "x y z keyframe t cx cy cz"),
    ):
        write_text(tmp_path / name, flight())
        lines = (tmp_path / name).read_text().splitlines()
        assert lines[0] == header
        assert {len(line.split(header[1])) for line in lines} == {8}


def test_what_is_not_known_stays_unknown(tmp_path: Path) -> None:
    unknown = Keyframe(np.array([[1.0, 2.0, 3.0]]))
    write_text(tmp_path / "a.txt", [unknown])
    (found,) = mlscli.open_recording(tmp_path / "a.txt").keyframes()
    assert math.isnan(found.stamp)
    assert np.isnan(found.position).all()


def test_an_existing_file_is_replaced_only_on_request(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("mine")
    with pytest.raises(OutputError, match="`overwrite`"):
        write_text(path, flight())
    assert path.read_text() == "mine"
    write_text(path, flight(), overwrite=True)
    assert path.read_text().startswith("x y z")
