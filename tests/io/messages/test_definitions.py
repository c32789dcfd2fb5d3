"""Definitions of messages, as recorded and as they should not be.

How these tests could be cheated: by refusing whatever is unusual. So beside each definition
that is refused there is one much like it that is read.
"""

from __future__ import annotations

import time
from typing import Any

import pytest
from rosbags.typesys import Stores, get_typestore

from mlscli.io.containers.container import Channel
from mlscli.io.containers.messagetypes import ros2_name
from mlscli.io.messages.definitions import smallest_size, typestore_of
from tests.helpers.ros import STORES

SEPARATOR = "=" * 80 + "\n"


def channel(text: str, schema_encoding: str = "ros2msg", encoding: str = "cdr") -> Channel:
    return Channel("/topic", "a_msgs/msg/A", encoding, text.encode(), schema_encoding, None)


@pytest.mark.parametrize(
    ("type_", "size"),
    [
        # Numbers of a twist and its covariances, 13 + 72 of eight bytes, the time and two strings.
        ("nav_msgs/msg/Odometry", 8 * (13 + 72) + 8 + 2 * 4),
        ("geometry_msgs/msg/Point32", 12),
        # Header, height, width, fields, order, steps, data, density.
        ("sensor_msgs/msg/PointCloud2", 12 + 8 + 4 + 1 + 8 + 4 + 1),
        ("tf2_msgs/msg/TFMessage", 4),
    ],
)
def test_the_smallest_message_has_empty_sequences_and_strings(type_: str, size: int) -> None:
    assert smallest_size(type_, STORES["cdr"].fielddefs) == size


@pytest.mark.parametrize("named", [False, True])
@pytest.mark.parametrize("encoding", ["ros1", "cdr"])
def test_without_a_schema_the_types_of_the_distribution_serve(encoding: str, named: bool) -> None:
    for type_ in ("sensor_msgs/msg/PointCloud2", "tf2_msgs/msg/TFMessage"):
        # Some converters write the name of the type where its definition belongs.
        schema = f"{type_}\n".encode() if named else b""
        recorded = Channel("/t", type_, encoding, schema, "ros2msg" if named else "", None)
        fields = typestore_of(recorded).fielddefs[type_][1]
        assert fields == STORES[encoding].fielddefs[type_][1]
    headers = typestore_of(Channel("/t", "std_msgs/msg/Header", encoding, b"", "", None)).fielddefs[
        "std_msgs/msg/Header"
    ][1]
    assert headers[0][0] == ("seq" if encoding == "ros1" else "stamp")


def test_definitions_in_idl_are_read_whether_one_or_several() -> None:
    point = "module a_msgs { module msg { struct P { double x; double y; }; }; };\n"
    whole = "module a_msgs { module msg { struct A { sequence<a_msgs::msg::P> points; }; }; };\n"
    several = f"{SEPARATOR}IDL: a_msgs/msg/A\n{whole}{SEPARATOR}IDL: a_msgs/msg/P\n{point}"

    store = typestore_of(channel(several, "ros2idl"))

    assert [name for name, _ in store.fielddefs["a_msgs/msg/P"][1]] == ["x", "y"]
    alone = "module a_msgs { module msg { struct A { double x; }; }; };\n"
    assert smallest_size("a_msgs/msg/A", typestore_of(channel(alone, "ros2idl")).fielddefs) == 8


@pytest.mark.parametrize(
    ("good", "bad", "words"),
    [
        ("B b\n===\nMSG: a_msgs/B\nuint8 x", "B b", "lacks the definition of a_msgs/msg/B"),
        ("B b\n===\nMSG: a_msgs/B\nuint8 x", "B b\n===\nMSG: a_msgs/B\nA a", "contains itself"),
        ("A2[] a\n===\nMSG: a_msgs/A2\nuint8 x", "A[] a", "contains itself"),
        ("B[] b\n===\nMSG: a_msgs/B\nuint8 x", "B[] b\n===\nMSG: a_msgs/B\n", "take no bytes"),
        ("float64[36] x", "float64[1000000000] x", "takes 8000000000 bytes"),
        ("string[9] x", "string[1000000000] x", "takes 4000000000 bytes"),
        (
            "B[3] b\n===\nMSG: a_msgs/B\nuint8 x",
            "B[99999999] b\n===\nMSG: a_msgs/B\nuint8 x",
            "takes 99999999 bytes",
        ),
        ("string x", "wstring x", "lacks the definition of a_msgs/msg/wstring"),
        ("uint8 x", "uint8 \x00", "parse"),
        ("uint8 x", "uint8", "parse"),
    ],
)
def test_a_definition_of_what_no_message_can_be_is_refused(good: str, bad: str, words: str) -> None:
    good, bad = (text.replace("===\n", SEPARATOR) + "\n" for text in (good, bad))

    assert smallest_size("a_msgs/msg/A", typestore_of(channel(good)).fielddefs)
    with pytest.raises(Exception, match=f"(?s){words}"):
        typestore_of(channel(bad))


def test_definitions_that_double_and_double_are_refused_at_once() -> None:
    texts = [f"T{n + 1} a\nT{n + 1} b\n" for n in range(60)] + ["uint8 x\n"]
    parts = [f"{SEPARATOR}MSG: a_msgs/T{n}\n{text}" for n, text in enumerate(texts)]

    with pytest.raises(ValueError, match="takes 131072 bytes or more"):
        typestore_of(channel("T0 t\n" + "".join(parts)))


def in_idl(rest: str) -> Channel:
    text = f"module a_msgs {{ module msg {{ {rest} struct A {{ double x; }}; }}; }};"
    return channel(text, "ros2idl")


@pytest.mark.parametrize(
    ("recorded", "words"),
    [
        (channel("int8 x\n" * 60_000), "60,000 lines or fields"),
        (channel(f"string A='{'a' * 600_000}'"), "600,011 characters"),
        (in_idl("const long C = ((1));"), "open \\("),
        (in_idl(f"struct B {{ {'sequence<' * 30}long{'>' * 30} x; }};"), "open <"),
        (in_idl(f"struct B {{ long x{'[1]' * 3}{'[' * 30}; }};"), "open \\["),
    ],
)
def test_definitions_that_would_take_a_parser_hours_are_refused_at_once(
    recorded: Channel, words: str
) -> None:
    begin = time.process_time()
    with pytest.raises(ValueError, match=words):
        typestore_of(recorded)
    assert time.process_time() - begin < 1


def test_annotations_and_comments_in_idl_cost_nothing_and_change_nothing() -> None:
    said = '@verbatim (language="comment", text="((([" "<<")'
    rest = f'{said} struct B {{ {said} long x; // (([\n }}; const string C = "((";'
    store = typestore_of(in_idl(f"/* (((( */ {rest}"))
    assert [name for name, _ in store.fielddefs["a_msgs/msg/B"][1]] == ["x"]


def test_strings_of_wide_characters_are_named() -> None:
    idl = "module a_msgs { module msg { struct A { wstring x; }; }; };\n"

    with pytest.raises(ValueError, match="a field of type wstring, which cannot be read"):
        typestore_of(channel(idl, "ros2idl"))
    typestore_of(channel(idl.replace("wstring", "string"), "ros2idl"))


@pytest.mark.parametrize("schema_encoding", ["jsonschema", "protobuf", "ros3"])
def test_a_schema_of_another_kind_is_named(schema_encoding: str) -> None:
    with pytest.raises(ValueError, match=f"written in '{schema_encoding}', expected ros1msg"):
        typestore_of(channel("uint8 x\n", schema_encoding))


@pytest.mark.parametrize("module", ["", "dds_"])
def test_clouds_that_recorders_of_dds_wrote_are_read(module: str) -> None:
    name = ros2_name(
        f"sensor_msgs::msg::{module}::PointCloud2_" if module else "sensor_msgs::msg::PointCloud2"
    )
    own = "struct {} {{ unsigned long height; sequence<octet> data; }};"
    inner = own.format("PointCloud2_" if module else "PointCloud2")
    inner = f"module {module} {{ {inner} }};" if module else inner
    idl = f"module sensor_msgs {{ module msg {{ {inner} }}; }};\n"

    types = typestore_of(Channel("/t", name, "cdr", idl.encode(), "omgidl", None)).fielddefs

    assert name == "sensor_msgs/msg/PointCloud2"
    fields = [field for field, _ in types[name][1]]
    # Names of DDS stand for the type of ROS; others say themselves what they are.
    assert ("point_step" in fields) == bool(module)
    assert {"height", "data"} <= set(fields)


def test_definitions_with_line_ends_of_windows_are_read() -> None:
    text = f"B b\n{SEPARATOR}MSG: a_msgs/B\nuint8 x\n".replace("\n", "\r\n")

    assert typestore_of(channel(text)).fielddefs["a_msgs/msg/B"][1]


def test_channels_do_not_change_the_types_of_others() -> None:
    before: Any = get_typestore(Stores.LATEST).fielddefs["sensor_msgs/msg/PointCloud2"]
    point_cloud = Channel("/t", "sensor_msgs/msg/PointCloud2", "cdr", b"uint8 x\n", "ros2msg", None)

    assert typestore_of(point_cloud).fielddefs["sensor_msgs/msg/PointCloud2"] != before
    assert get_typestore(Stores.LATEST).fielddefs["sensor_msgs/msg/PointCloud2"] == before


def test_what_a_definition_in_idl_includes_follows_in_the_recording() -> None:
    idl = (
        f'{"=" * 80}\nIDL: a_msgs/msg/A\n#include "a_msgs/msg/B.idl"\n'
        "module a_msgs { module msg { struct A { a_msgs::msg::B b; }; }; };\n"
        f"{'=' * 80}\nIDL: a_msgs/msg/B\n  # include <none.idl>\n"
        "module a_msgs { module msg { struct B { double x; }; }; };\n"
    )
    channel = Channel("/a", "a_msgs/msg/A", "cdr", idl.encode(), "ros2idl", None)

    assert set(typestore_of(channel).fielddefs) >= {"a_msgs/msg/A", "a_msgs/msg/B"}
