"""How texts are written.

How these tests could be cheated: by one separator that happens to part the example, by splitting
what quotes protect, by taking a decimal comma for a separator where a row has whole numbers, or by
a parser that is right for the blocks that numpy reads and not for those taken line by line. So each
kind is written in several ways, with the same points; decimal commas stand in one row alone; and
each text is read as it is and with a quoted comment that sends it the slow way.
"""

from __future__ import annotations

import math
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mlscli.errors import InputError
from mlscli.io.clouds.dialect import Dialect, encoding_of, has_decimal_comma, is_number, number
from mlscli.io.clouds.text import TextCloud
from tests.helpers.texts import one_cloud, read, text

POINTS = [[0.5, 1.25, -3.0], [2.5, 4.0, 1.5], [7.5, 0.25, 0.0]]


def rows(form: str, points: list[list[float]] = POINTS) -> str:
    """Return a line for each point; ``{n}`` in its form is the number of the row."""
    return "".join(form.format(*point, n=n) + "\n" for n, point in enumerate(points))


KINDS = {
    "blanks in names and fields": "Point No,X (m),Y [m],Z\n" + rows("P {n},{0},{1},{2}"),
    "blanks in names, semicolons": "Scan Nr;X;Y;Z;Refl\n" + rows("{n};{0};{1};{2};55"),
    "blanks in names, tabs": "Point No\tX\tY\tZ\n" + rows("P {n}\t{0}\t{1}\t{2}"),
    "dates": "time,x,y,z\n" + rows("2024-05-01 12:00:0{n},{0},{1},{2}"),
    "an index without a name": ",x,y,z\n" + rows("{n},{0},{1},{2}"),
    "an index without a name, tabs": "\tx\ty\tz\tclass name\n"
    + rows("{n}\t{0}\t{1}\t{2}\tlow veg"),
    "tabs before each row": "x y z\n" + rows("\t{0}\t{1}\t{2}"),
    "colours": "x,y,colour,z\n" + rows("{0},{1},#ff880{n},{2}"),
    "quoted labels of a hash and a number": "x;y;label;z\n" + rows('{0};{1};"#1{n}";{2}'),
    "rows that are commented out": "x y z\n#12 1 2\n\t#3,4\n" + rows("{0} {1} {2}") + "#1 2 3\n",
    "a quoted index without a name": '"","x","y","z"\n' + rows('"{n}",{0},{1},{2}'),
    "a label with a comma": "label,x,y,z,q\n" + rows('"Wall {n}, north",{0},{1},{2},1'),
    "a label with a quote": "label,x,y,z\n" + rows('"a ""{n}"", b",{0},{1},{2}'),
    "a label with a semicolon": "x,y,z,label\n" + rows("{0},{1},{2},a;b;c;d;e"),
    "a label with a comma, semicolons": "label;x;y;z\n" + rows("a, b, c, d;{0};{1};{2}"),
    "a label with a hash": "label,x,y,z\n" + rows("P#{n},{0},{1},{2}"),
    "a quoted label with a hash": "label,x,y,z\n" + rows('"no. #{n}",{0},{1},{2}'),
    "a quoted label among blanks": "label x y z\n" + rows('"Wall {n} north" {0} {1} {2}'),
    "everything quoted": '"x","y","z"\n' + rows('"{0}","{1}","{2}"'),
    "single quotes": rows("'{0}','{1}','{2}'"),
    "sep=,": "sep=,\nx,y,z\n" + rows("{0},{1},{2}"),
    "sep=;": '"sep=;"\r\n\nx;y;z\n' + rows("{0};{1};{2}"),
    "tabs and blanks": rows("{0}\t {1} \t{2}"),
    "tabs side by side": rows("{0}\t\t{1}\t\t{2}"),
    "separators at the ends": rows("{0},{1},{2},,,"),
    "words that are not used": "x,y,z,class\n" + rows("{0},{1},{2},?--"),
    "a decimal comma that is not used": "x;y;z;i\n" + rows("{0};{1};{2};0,5"),
    "Windows' words that are not used": "x y z nx\n" + rows("{0} {1} {2} -1.#IND"),
    "a count": "3\n" + rows("{0},{1},{2}"),
    "a header and a count": "//X Y Z R G B\n3\n" + rows("{0} {1} {2} 1 2 3"),
    "a count and a header": "3\nx;y;z\n" + rows("{0};{1};{2}"),
    "a title and units": "Survey of May\nx,y,z\nm,m,m\n" + rows("{0},{1},{2}"),
    "ParaView": '"Points:0","Points:1","Points:2","i"\n' + rows("{0},{1},{2},4"),
    "VeloView": '"i","Points_m_XYZ:0","Points_m_XYZ:1","Points_m_XYZ:2"\n' + rows("4,{0},{1},{2}"),
    "VeloView, with both": "Points_m_XYZ:0,Y,Points_m_XYZ:2,X,Z\n" + rows("9,{1},9,{0},{2}"),
    "comments of MATLAB": "% z, y, x\n" + rows("{2},{1},{0}"),
    "umlauts": "Straße,x,y,z\n" + rows("Köln {n},{0},{1},{2}"),
}


@pytest.mark.parametrize("ending", ["\n", "\r\n"])
@pytest.mark.parametrize("slow", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_each_way_of_writing_gives_the_points(
    tmp_path: Path, kind: str, slow: bool, ending: str
) -> None:
    content = KINDS[kind] + '# "that" was all\n' * slow

    assert one_cloud(tmp_path, content.replace("\n", ending)) == POINTS


DECIMAL_COMMAS = {
    "quoted": "x,y,z\n" + rows('"0,5","{n},5","0,25"'),
    "semicolons": rows("0,5;{n},5;0,25"),
    "semicolons and an id": "id;x;y;z\n" + rows("{n};0,5;{n},5;0,25"),
    "semicolons, in one row": "1;2;3\n4;5;6\n7;8,5;9\n",
    "tabs": rows("0,5\t{n},5\t0,25"),
    "blanks": rows("0,5 {n},5 0,25"),
    "blanks, in one row": "1 2 3\n4 5 6\n7 8 9,5\n",
    "blanks, whole ones among them": rows("4,5 6 7"),
    "blanks and a label": "name x y z\n" + rows("P{n} 0,5 {n},5 0,25"),
    "blanks and colours": rows("0,5 {n},5 0,25 10 20 30"),
    "exponents": rows("5,0e-1 {n},5E0 ,25"),
    "commas as separators, too": rows("0,05,{n},50,0,25"),
}


@pytest.mark.parametrize("kind", DECIMAL_COMMAS)
def test_decimal_commas_are_refused_and_never_split(tmp_path: Path, kind: str) -> None:
    with pytest.raises(InputError, match=r"expected (a number with a decimal|decimal) point"):
        read(tmp_path, DECIMAL_COMMAS[kind])


@pytest.mark.parametrize(
    "encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32", "utf-16-be with a mark"]
)
@pytest.mark.parametrize("columns", [None, "x,y,z"])
def test_an_encoding_is_told_by_its_first_bytes(
    tmp_path: Path, encoding: str, columns: str | None
) -> None:
    content = "1,2,3\r\n4,5,6\r\n"
    encoded = content.encode(encoding.split()[0])
    if "with" in encoding:
        encoded = b"\xfe\xff" + encoded

    assert one_cloud(tmp_path, encoded, columns) == [[1, 2, 3], [4, 5, 6]]


@given(st.binary(max_size=40))
def test_any_bytes_have_an_encoding(head: bytes) -> None:
    assert isinstance(head.decode(encoding_of(head), "replace"), str)


@pytest.mark.parametrize(
    ("word", "value"),
    [
        *(
            (word, math.nan)
            for word in ("-nan(ind)", "1.#IND", "-1.#IND00", "1.#QNAN", "nan(snan)")
        ),
        *((word, math.nan) for word in ("NA", "n/a", "null", "None", "#N/A", "", "-nan", "qnan")),
        *((word, math.inf) for word in ("1.#INF", "1.#INF00", "inf", "Infinity", "1.inf")),
        *((word, -math.inf) for word in ("-1.#INF", "-inf")),
        *((word, 12.5) for word in ("12.5", "+12.5", "1.25e1", "1250E-2", "012.50")),
        (".5", 0.5),
        ("5.", 5.0),
    ],
)
def test_a_word_is_the_number_that_it_means(tmp_path: Path, word: str, value: float) -> None:
    np.testing.assert_equal(number(word), value)
    # The others of its row are not lost.
    (cloud,) = read(tmp_path, f"x,y,z\n{word},2,3\n4,5,6\n7,8,9\n")
    np.testing.assert_equal(cloud.points, [[value, 2, 3], [4, 5, 6], [7, 8, 9]])


@pytest.mark.parametrize("end", ["", "x", ".5.", ",5", "e"])
def test_a_word_of_a_million_digits_costs_no_square(end: str) -> None:
    begin = time.process_time()
    assert is_number(f"{'9' * 10**6}{end}") == (not end)
    assert time.process_time() - begin < 1


@pytest.mark.parametrize(
    "word",
    ["1_0", "0x1", "1,5", "1.2.3", "five", "\uff11\uff12", "\u0663", "1e", "--1", "1 2", "1.#"],
)
def test_any_other_word_is_no_number(tmp_path: Path, word: str) -> None:
    assert not is_number(word)
    with pytest.raises(ValueError):  # noqa: PT011
        number(word)
    with pytest.raises(InputError, match=r"cloud.txt:1: found .* as y, expected a number"):
        read(tmp_path, f"1;{word};3\n5;6;7\n5;6;7\n")


@given(st.floats(allow_nan=False), st.sampled_from([repr, "{:.3f}".format, "{:e}".format]))
def test_a_number_with_a_decimal_comma_is_told_from_all_others(value: float, form: object) -> None:
    assert callable(form)
    word = form(value)
    assert number(word) == float(word)
    assert not has_decimal_comma(word)
    assert has_decimal_comma(word.replace(".", ",")) == ("." in word)


@pytest.mark.parametrize(
    ("lines", "separator", "width"),
    [
        (["1 2 3"], "", 3),
        (["1, 2, 3"], ",", 3),
        (["1;2,5;3"], ";", 3),
        (["0,5 0,5 0,0", "1 2 3"], "", 3),
        (["a b\t1\t2\t3"], "\t", 4),
        (["1\t2\t3\t7", "1\t\t3\t7", "1\t5\t3\t7"], "\t", 4),
        (["1,2,3", "1,2", "4,5,6"], ",", 3),
        (["a,b,c"], ",", 3),
        (["# 1;2;3", "// 1;2;3", "1 2 3 4"], "", 4),
        ([], "", 0),
    ],
)
def test_the_separator_is_what_makes_alike_rows(
    lines: list[str], separator: str, width: int
) -> None:
    assert Dialect.of(lines) == (separator, width)


def test_a_missing_value_between_tabs_moves_none_to_its_place(tmp_path: Path) -> None:
    (cloud,) = read(tmp_path, "1\t2\t3\t7.5\n4\t\t6\t7.5\n7\t8\t9\t7.5\n")

    np.testing.assert_equal(cloud.points, [[1, 2, 3], [4, np.nan, 6], [7, 8, 9]])


def test_rows_of_differing_lengths_are_told(tmp_path: Path) -> None:
    cloud = TextCloud(text(tmp_path, "1 2 3 4 5\n" * 9 + "1 2 3\n" + "1 2 3 4 5 6\n" * 2))

    assert [len(each.points) for each in cloud.clouds()] == [12]
    assert ["3 of 12 rows have more or fewer columns" in note for note in cloud.notes] == [
        False,
        True,
    ]
    # Where a header names the columns, a row that has more may hold anything anywhere.
    with pytest.raises(InputError, match=r"cloud.txt:3: found 5 columns .* the 4 of the header"):
        read(tmp_path, "label,x,y,z\na,1,2,3\nWall, north,1,2,3\n")
    with pytest.raises(InputError, match=r"cloud.txt:3: found 3 columns .* the 4 of the header"):
        read(tmp_path, "label x y z\na 1 2 3\n1 2 3\n")


@pytest.mark.parametrize("quoted", ["a" * 140_000, 'a"\rb', "a\0b"])
def test_a_quoted_field_without_end_is_one_that_holds_no_number(quoted: str) -> None:
    fields = Dialect(",", 3).fields(f'"{quoted}",1,2.5')
    assert fields[-2:] == ["1", "2.5"]
    assert not is_number(fields[0])
