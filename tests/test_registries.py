"""What every stage and every format owes: whoever adds one finds here what is missing.

How one could cheat: to leave a stage or a format out of the tables below, so these are held
against the registries; an example that is recognised by its name, so examples have none that says
what they are; a damaged twin that is read as if it were whole, so points must lack or be refused,
and a loss be named.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from benchmarks.compiling import EVERY
from mlscli.config import preset_text
from mlscli.errors import InputError
from mlscli.io.reading.formats import FORMATS, Format, open_source, readable
from mlscli.pipeline.stages.registry import STAGES
from mlscli.pipeline.stages.stage import MapStage, PointStage
from mlscli.runtime.arrays import Float64
from tests.helpers import point_references, references
from tests.helpers.examples import EXAMPLES, LINES, POINTS
from tests.helpers.pipelines import MAP_STAGES
from tests.pipeline.stages.test_stages import STAGES as COMPARED

DOCS = Path(__file__).resolve().parent.parent / "docs"


def table(page: str) -> list[str]:
    """Return the first cells of the rows of the first table of a page."""
    lines = (DOCS / page).read_text(encoding="utf-8").splitlines()
    rows = [line.split("|")[1].strip() for line in lines if line.startswith("|")]
    return rows[2:]


# --- stages ---


@pytest.mark.parametrize("name", STAGES)
def test_a_stage_has_a_reference_a_row_in_the_docs_and_a_comment_in_the_presets(name: str) -> None:
    home = point_references if issubclass(STAGES[name], PointStage) else references
    assert callable(getattr(home, name, None)), home.__file__
    assert f"`{name}`" in table("stages.md"), "docs/stages.md"
    presets = preset_text("default") + preset_text("thesis")
    assert re.search(rf"^ *#.*\n(?: *#.*\n)* *(?:# ?)?- {name}\b", presets, re.MULTILINE), (
        "configs/"
    )


def test_every_stage_on_maps_is_compared_drawn_and_compiled() -> None:
    on_maps = {name for name, stage in STAGES.items() if issubclass(stage, MapStage)}
    compared = {draw.__name__ for draw in COMPARED}
    assert compared == on_maps, "STAGES in tests/pipeline/stages/test_stages.py"
    assert MAP_STAGES.keys() == on_maps, "MAP_STAGES in tests/helpers/pipelines.py"
    compiled = {stage.partition(":")[0] for stage in EVERY}
    assert compiled == STAGES.keys(), "EVERY in benchmarks/compiling.py"


# --- formats ---


READABLE = [format_ for format_ in FORMATS if format_.open is not None]


def name_of(format_: Format) -> str:
    return format_.name


def clouds_of(path: Path) -> tuple[Float64, list[str]]:
    """Return all points of a source, and what it says is lost."""
    source = open_source(path)
    points = np.concatenate([np.empty((0, 3)), *(cloud.points for cloud in source.clouds())])
    return points, [*source.losses]


def read_or_refused(path: Path) -> tuple[Float64, list[str], str]:
    """Return points and losses, or else the words of the refusal."""
    try:
        return *clouds_of(path), ""
    except InputError as error:
        return np.empty((0, 3)), [], str(error)


def damage(path: Path) -> None:
    """Cut the largest file of a recording in half; in a text without a header, spoil a number."""
    if path.is_dir():
        path = max(path.iterdir(), key=lambda file: file.stat().st_size)
    content = path.read_bytes()
    if content == LINES.encode():
        path.write_bytes(content.replace(b" ", b" ?", 1))
    else:
        path.write_bytes(content[: len(content) // 2])


def test_every_format_has_an_example() -> None:
    assert {format_.name for format_ in READABLE} == EXAMPLES.keys()


@pytest.mark.parametrize("format_", READABLE, ids=name_of)
def test_a_format_is_read_and_its_damaged_twin_read_in_part_or_refused(
    format_: Format, tmp_path: Path
) -> None:
    path = EXAMPLES[format_.name](tmp_path)
    points, losses = clouds_of(path)
    np.testing.assert_allclose(points, POINTS, atol=0.005)
    assert losses == []
    damage(path)
    points, losses, refusal = read_or_refused(path)
    if refusal:
        assert refusal.startswith(str(tmp_path))
        assert "\n" not in refusal
    else:
        left = points[np.isfinite(points).all(axis=1)]
        assert len(left) < len(POINTS)
        assert losses or len(left) < len(points)


# The folder of a ROS 2 bag holds no more than a SQLite file.
@pytest.mark.parametrize("format_", [f for f in READABLE if f.name != "ROS 2 bag"], ids=name_of)
def test_a_file_cut_anywhere_yields_what_lay_before_the_cut_and_tells_the_loss(
    format_: Format, tmp_path: Path
) -> None:
    path = EXAMPLES[format_.name](tmp_path)
    whole, _ = clouds_of(path)
    # Of a text nothing tells that its last number is cut, nor how many rows there were.
    is_text = format_.name in ("text", "COLMAP model")
    file = max(path.iterdir(), key=lambda each: each.stat().st_size) if path.is_dir() else path
    content, read = file.read_bytes(), 0
    for place in range(200):
        size = len(content) * place // 200
        file.write_bytes(content[:size])
        points, losses, refusal = read_or_refused(path)
        if refusal:
            assert refusal.startswith(str(tmp_path))
            assert "\n" not in refusal
            continue
        sure = max(len(points) - is_text, 0)
        assert points[:sure].tolist() == whole[:sure].tolist()
        assert losses or is_text
        read += len(points) > 0
    # JSON is refused, and one block of zstandard yields nothing before its end.
    assert read > 60 or format_.name in ("OpenSfM", "a file of a ROS 2 bag, compressed")


@pytest.mark.parametrize("format_", READABLE, ids=name_of)
def test_a_format_has_a_row_in_the_docs(format_: Format) -> None:
    words = format_.name.removeprefix("a file of a ").split(",")[0].lower()
    assert any(words in row.lower() for row in table("reading.md")), "docs/reading.md"


def test_the_list_of_formats_names_them_all() -> None:
    listed = readable().lower()
    for format_ in READABLE:
        if format_.listed:
            assert format_.listed.lower() in listed
