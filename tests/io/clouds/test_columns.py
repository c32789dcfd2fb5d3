"""Columns of text: their names, and lines that do not hold them.

How these tests could be cheated: by line numbers that count only lines with points, or by
headers known letter for letter. So headers come in the spellings of several programs, and broken
lines after blank lines, comments and headers, in blocks of a few characters too.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from mlscli.errors import InputError, UsageError
from mlscli.io.clouds import rows as rows_module
from tests.helpers.texts import clouds_of, one_cloud, read


@pytest.mark.parametrize(
    "header",
    [
        "z,keyframe,y,x",
        "Z;KF;Y;X",
        "pos_z, kf_id, pos_y, pos_x",
        '"z","keyframe","y","x"',
        "//Z keyframe Y X",
        "# exported\n# z kf y x",
        "\ufeffz keyframe y x",
    ],
)
def test_a_header_names_the_columns(tmp_path: Path, header: str) -> None:
    clouds = clouds_of(tmp_path, f"{header}\n3,0,2,1\n6,1,5,4\n9,0,8,7\n")

    assert clouds == [[[1, 2, 3], [7, 8, 9]], [[4, 5, 6]]]


def test_a_comment_of_other_length_than_the_rows_is_no_header(tmp_path: Path) -> None:
    content = "# z y x in metres, as they were surveyed\n1 2 3\n"

    assert one_cloud(tmp_path, content) == [[1, 2, 3]]


def test_columns_given_by_the_user_outrank_a_header(tmp_path: Path) -> None:
    assert one_cloud(tmp_path, "x y z\n1 2 3\n", "z,y,x") == [[3, 2, 1]]


def test_a_skipped_column_may_hold_words(tmp_path: Path) -> None:
    assert one_cloud(tmp_path, "a.jpg 1 2 3\nb.jpg 4 5 6\n", "-,x,y,z") == [[1, 2, 3], [4, 5, 6]]


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ("x,y,q", "found 'q'"),
        ("x,y,z,y", "y is named more than once"),
        ("x,y", "z missing"),
        ("", "found ''"),
        ("x,y,z,cx,cz", "cy missing"),
        ("x,y,z,qx,qy,qz", "qw missing"),
    ],
)
def test_wrong_names_of_columns_are_refused_with_the_valid_ones(
    tmp_path: Path, columns: str, words: str
) -> None:
    with pytest.raises(UsageError, match=words) as error:
        read(tmp_path, "1 2 3\n", columns)
    assert "x, y, z, keyframe, t, cx, cy, cz, qx, qy, qz, qw" in str(error.value)


# Broken files


@pytest.mark.parametrize(
    ("content", "columns", "words"),
    [
        ("1 2 3\n\n# note\n4 five 6\n", None, "cloud.txt:4: found 'five' as y, expected a number"),
        ("1 2 3\n4 5\n", None, r"cloud.txt:2: found 2 columns \('4 5'\), expected z in column 3"),
        ("x,y,z\n1,2,3\n1.2.3,1,1\n", None, "cloud.txt:3: found '1.2.3' as x"),
        ("1 2 3\n1_0 2 3\n", None, "cloud.txt:2: found '1_0' as x"),
        ("1 2 3\r\n0x1 2 3\r\n", None, "cloud.txt:2: found '0x1' as x"),
        ("1,2,3,4\n1,2,3,\n", "x,y,z,keyframe", "cloud.txt:2: found 3 columns"),
        ("1,2,,3\n", "x,y,keyframe,z", "cloud.txt:1: found nothing as keyframe"),
        ("1,2,nan,3\n", "x,y,keyframe,z", "cloud.txt:1: found 'nan' as keyframe"),
        ("a,b,c\n1,2,3\n", None, "found 'a,b,c' before the first point"),
        ("x,y,z,x\n1,2,3,4\n", None, "names x, y and z once each"),
        ("# nothing but this\n", None, "holds no points"),
        ("x,y,z\n", None, "holds no points"),
        ("0.1,0.2,0.30.4,0.5,0.6" * 10_000, None, "cloud.txt:1: found a line of more than 65536"),
        ("1 2 3\n" + "7" * 70_000, None, "cloud.txt:2: found a line of more than 65536"),
    ],
)
@pytest.mark.parametrize("block", [1 << 22, 9])
def test_a_broken_line_is_named_with_what_was_found(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    content: str,
    columns: str | None,
    words: str,
    block: int,
) -> None:
    monkeypatch.setattr(rows_module, "BLOCK_CHARACTERS", block)
    with pytest.raises(InputError, match=words) as error:
        read(tmp_path, content, columns)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 400


def test_a_file_cut_anywhere_is_read_or_refused_on_one_line(tmp_path: Path) -> None:
    whole = "x, y, z, keyframe\n0.5, -1.25, 2e-3, 7\n\n1, 2, 3, 8 # end\n"
    for length in range(1, len(whole)):
        try:
            clouds = read(tmp_path, whole[:length])
        except InputError as error:
            assert "\n" not in str(error)  # noqa: PT017
        else:
            assert sum(len(cloud.points) for cloud in clouds) >= 1
