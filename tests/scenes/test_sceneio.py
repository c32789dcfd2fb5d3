"""Scenes in YAML: what they say is what is built, and every fault is told at its place.

Ways to pass without being right: to stop at the first fault; to read a key and drop its value.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from mlscli.errors import ConfigError, InputError
from mlscli.scenes.sceneio import load_legs, load_scene, parse_scene
from mlscli.scenes.surfaces import Leg, Rectangle, Scatter, Scene, add_horizontal, add_vertical

SHED = """
surfaces:
  - horizontal: {position: [0, 0, 0], size: [6, 4.5]}
  - horizontal:
      position: [1, 2, 3]
      size: [2, 1]
      orientation: 30
      grade: -0.2
      scatter: [0.01, 0.02]
      texture: 0.25
      openings: [[0.5, 1, 0.25, 0.75]]
      textureless: [[0, 0.5, 0, 1], [1.5, 2, 0, 1]]
  - vertical: {position: [0, 1, 1], size: [3, 2], orientation: 90, openings: [[1, 2, 0.5, 1.5]]}
legs:
  - {start: [0, -3, 1], end: [0, 3, 1], tilt: 80, yaw: -90}
  - {start: [1, 0, 1], end: [2, 0, 1]}
"""


def faults(text: str) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        parse_scene(text, "s.yaml")
    return list(caught.value.faults)


def test_a_scene_is_what_its_building_blocks_make() -> None:
    scene = add_horizontal(Scene("shed"), (0, 0, 0), (6, 4.5))
    scene = add_horizontal(
        scene, (1, 2, 3), (2, 1), 30, -0.2, Scatter(0.01, 0.02),
        openings=[Rectangle(0.5, 1, 0.25, 0.75)], texture=0.25,
        textureless=[Rectangle(0, 0.5, 0, 1), Rectangle(1.5, 2, 0, 1)],
    )  # fmt: skip
    scene = add_vertical(scene, (0, 1, 1), (3, 2), 90, openings=[Rectangle(1, 2, 0.5, 1.5)])
    scene = scene.with_legs(Leg((0, -3, 1), (0, 3, 1), 80, -90), Leg((1, 0, 1), (2, 0, 1)))
    assert parse_scene(SHED, "some/shed.yaml") == scene


def test_a_bare_list_is_a_scene_without_legs() -> None:
    scene = parse_scene("- vertical: {position: [0, 0, 1], size: [3, 2]}", "wall.yaml")
    assert scene == add_vertical(Scene("wall"), (0, 0, 1), (3, 2))


def test_every_fault_is_told_at_its_place() -> None:
    text = """surfaces:
  - horizontal: {position: [0, 0], size: [6, 0]}
  - horizonal: {position: [0, 0, 0], size: [6, 6]}
  - vertical: {size: [1, 1], colour: red, texture: 2}
  - vertical: {position: [0, 0, .inf], size: [1, yes], position: [0, 0, 0]}
  - floor
  - vertical: {position: [0, 0, 0], size: [1, 1], openings: [[1, 0, 0, 1]]}
  - horizontal: {position: [0, 0, 0], size: [1, 1], openings: [[1, 0, 0], 3]}
legs:
  - {start: [0, 0, 0], tilt: -3}
route: 1
"""
    assert faults(text) == [
        "s.yaml:2:28: horizontal.position: found [0, 0]; expected 3 numbers, [x, y, z]",
        "s.yaml:2:42: horizontal.size: found [6, 0]; expected 2 numbers, [length, width or height] "
        "above 0",
        "s.yaml:3:5: surfaces.horizonal: unknown surface; did you mean horizontal?",
        "s.yaml:4:5: vertical.position: is missing; expected 3 numbers, [x, y, z]",
        "s.yaml:4:30: vertical.colour: unknown key; valid here: position, size, orientation, "
        "grade, scatter, texture, openings, textureless",
        "s.yaml:4:52: vertical.texture: found 2; expected a number of at least 0 at most 1",
        "s.yaml:5:26: vertical.position: found [0, 0, '.inf']; expected 3 numbers, [x, y, z]",
        "s.yaml:5:46: vertical.size: found [1, 'yes']; expected 2 numbers, [length, width or "
        "height] above 0",
        "s.yaml:5:56: vertical.position: given twice, first in line 5; keep one",
        "s.yaml:6:5: surfaces: found 'floor'; expected one of horizontal: {...} or vertical: "
        "{...} for each '-'",
        "s.yaml:7:5: vertical.openings: found [1, 0, 0, 1]; expected each low below its high: "
        "[a_low, a_high, b_low, b_high]",
        "s.yaml:8:64: horizontal.openings: found [1, 0, 0]; expected 4 numbers, "
        "[a_low, a_high, b_low, b_high]",
        "s.yaml:8:75: horizontal.openings: found 3; expected 4 numbers, "
        "[a_low, a_high, b_low, b_high]",
        "s.yaml:10:5: legs.end: is missing; expected 3 numbers, [x, y, z]",
        "s.yaml:10:30: legs.tilt: found -3; expected a number of at least 0 at most 180",
        "s.yaml:11:1: route: unknown key; valid here: surfaces, legs",
    ]


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("", "found nothing; expected a list of surfaces"),
        ("3", "found 3; expected a list of surfaces"),
        ("[]", "surfaces: none is given; a scene has at least one"),
        ("surfaces: 3", "surfaces: found 3; expected a list"),
        ("legs: []", "surfaces: none is given"),
        ("[", "no valid YAML"),
        ("- &a vertical", "anchors are not taken"),
        ("- vertical: {position: [1e9, 0, 0], size: [1, 1]}", "found [1000000000.0, 0, 0]"),
        ("- vertical: {position: [true, 0, 0], size: [1, 1]}", "found [true, 0, 0]"),
        ("- vertical: {position: [0, 0, 0], size: 3}", "found 3; expected 2 numbers"),
        ("- vertical: 3", "vertical: found 3; expected position, size"),
        ("- {}", "found keys with values; expected one of horizontal"),
    ],
)
def test_what_is_no_scene_is_refused_in_a_line(text: str, fault: str) -> None:
    found = faults(text)
    assert fault in found[0]
    assert found[0].startswith("s.yaml:")


def test_files_are_named_in_what_is_wrong_with_them(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    with pytest.raises(InputError, match=r"a\.yaml: no such file"):
        load_scene(path)
    path.write_bytes(b"- \xff")
    with pytest.raises(InputError, match=r"a\.yaml: byte 0xff"):
        load_scene(path)
    with pytest.raises(InputError, match="cannot be read as a scene"):
        load_scene(tmp_path)
    path.write_text(SHED)
    assert load_scene(path).name == "a"


# --- routes ---

LEGS = """
- {start: [0, -3, 1], end: [0, 3, 1], tilt: 80, yaw: -90}
- {start: [1, 0, 1], end: [2, 0, 1]}
"""


def test_a_route_is_a_list_of_legs_bare_or_under_its_key(tmp_path: Path) -> None:
    path = tmp_path / "way.yaml"
    legs = (Leg((0, -3, 1), (0, 3, 1), 80, -90), Leg((1, 0, 1), (2, 0, 1)))
    for text in (LEGS, "legs:" + LEGS):
        path.write_text(text)
        assert load_legs(path) == legs


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("", ":1:1: found nothing; expected a list of legs"),
        ("x", ":1:1: found 'x'; expected a list of legs"),
        ("[]", ":1:1: legs: none is given; a route has at least one"),
        ("legs: 3", ":1:7: legs: found 3; expected a list"),
        ("surfaces: []", ":1:1: surfaces: unknown key; valid here: legs"),
        ("- {start: [0, 0, 0]}", ":1:3: legs.end: is missing; expected 3 numbers, [x, y, z]"),
        ("- {start: [0, 0, 0], end: [1, 0, 0], tilt: 181}", "legs.tilt: found 181; expected"),
        ("[", "no valid YAML"),
    ],
)
def test_what_is_no_route_is_refused_in_a_line(text: str, fault: str, tmp_path: Path) -> None:
    path = tmp_path / "way.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_legs(path)
    assert fault in caught.value.faults[0]
    assert caught.value.faults[0].startswith(str(path))


def test_a_route_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no\.yaml: no such file; `legs` takes a route in YAML"):
        load_legs(tmp_path / "no.yaml")
    with pytest.raises(InputError, match="cannot be read as a route"):
        load_legs(tmp_path)
