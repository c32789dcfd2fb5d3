"""MCAP files: of any profile, with and without indexes, cut, rotten.

Ways to pass without being right: all chunks read although the index tells which to; checksums
that are never looked at; the messages of a file without chunks held together to sort them.
"""

from __future__ import annotations

import random
import struct
from pathlib import Path
from typing import Any

import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.reader import NonSeekingReader
from mcap.records import ChunkIndex
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter

from mlscli.io.containers.mcapfile import McapFile
from mlscli.io.containers.mcaprecords import chunk_by_index
from mlscli.io.containers.opening import open_container
from tests.helpers.broken import (
    SECOND,
    STRING,
    Sent,
    allocating_less_than,
    by_anyreader,
    check_bit_rot,
    check_every_cut,
    content,
    flight,
    mcap_records,
    refusal,
    told,
    whole_in_mcap,
    write_mcap,
)

COMPRESSIONS = pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
FORMS: dict[str, dict[str, Any]] = {
    "chunks": {},
    "large chunks": {"chunk_size": 10**7},
    "no chunks": {"use_chunking": False},
    "no summary": {
        "index_types": IndexType.NONE, "repeat_channels": False, "repeat_schemas": False,
        "use_statistics": False, "use_summary_offsets": False,
    },
    "no chunk indexes": {"index_types": IndexType.MESSAGE},
    "no message indexes": {"index_types": IndexType.CHUNK},
    "no channels in the summary": {"repeat_channels": False, "repeat_schemas": False},
    "no statistics": {"use_statistics": False},
    "no checksums": {"enable_crcs": False},
}  # fmt: skip
EVERY_FORM = pytest.mark.parametrize("form", list(FORMS))


def by_mcap(path: Path) -> list[Sent]:
    with path.open("rb") as file:
        return [
            Sent(channel.topic, message.log_time, message.data)
            for _, channel, message in NonSeekingReader(file).iter_messages()
        ]


@pytest.mark.parametrize("name", ["ros1_ouster_in_mcap_zstd", "ros2_nav2_turtlebot"])
def test_a_recorded_file_reads_as_mcap_reads_it(shared_data: Path, name: str) -> None:
    path = shared_data / "bags" / f"{name}.mcap"
    file = open_container(path)
    expected = by_mcap(path)
    assert content(file) == expected
    assert file.kind == "MCAP"
    assert file.losses == []
    assert file.time_span == (expected[0].log_time, expected[-1].log_time)
    for channel in file.channels:
        assert channel.count == sum(message.topic == channel.topic for message in expected)


def test_a_recorded_file_reads_as_rosbags_reads_it(shared_data: Path) -> None:
    path = shared_data / "bags" / "ros2_nav2_turtlebot.mcap"
    assert content(McapFile(path)) == by_anyreader(path)


def test_ros_1_messages_have_ros_2_names_and_two_channels_of_one_name_are_one(
    shared_data: Path,
) -> None:
    file = McapFile(shared_data / "bags" / "ros1_ouster_in_mcap_zstd.mcap")
    points = [channel for channel in file.channels if channel.topic == "/os1_cloud_node/points"]
    assert [(c.type, c.encoding, c.schema_encoding, c.count) for c in points] == [
        ("sensor_msgs/msg/PointCloud2", "ros1", "ros1msg", 2)
    ]


@EVERY_FORM
@COMPRESSIONS
def test_a_written_file_reads_back(tmp_path: Path, compression: str, form: str) -> None:
    messages = flight()
    file = McapFile(write_mcap(tmp_path / "a.mcap", messages, compression, **FORMS[form]))
    assert content(file) == messages
    assert file.losses == []
    assert file.time_span == (SECOND, len(messages) * SECOND)
    assert [(c.topic, c.type, c.schema, c.count) for c in file.channels] == [
        (topic, STRING, b"string data", len(messages) // 2) for topic in ("/a", "/b")
    ]
    next(file.messages())
    assert content(file, ["/b"]) == [message for message in messages if message.topic == "/b"]
    assert file.losses == []


@EVERY_FORM
def test_messages_come_in_the_order_of_time_and_equal_times_in_that_of_the_file(
    tmp_path: Path, form: str
) -> None:
    rng = random.Random(3)
    messages = [m._replace(log_time=SECOND + rng.randrange(40)) for m in flight(300)]
    file = McapFile(write_mcap(tmp_path / "a.mcap", messages, **FORMS[form]))
    assert content(file) == sorted(messages, key=lambda m: m.log_time)


@pytest.mark.parametrize("form", ["chunks", "no chunks", "no summary"])
def test_only_what_overlaps_in_time_is_held(tmp_path: Path, form: str) -> None:
    messages = flight(240, size=100_000)
    file = McapFile(write_mcap(tmp_path / "a.mcap", messages, **FORMS[form]))
    with allocating_less_than(4_000_000):
        assert sum(len(message.data) for message in file.messages()) > 20_000_000


def test_of_other_encodings_names_stay_and_a_schema_may_be_missing(tmp_path: Path) -> None:
    path = write_mcap(
        tmp_path / "a.mcap", flight(2), encoding="protobuf", schema="protobuf",
        type_="foxglove.PointCloud",
    )  # fmt: skip
    assert {(c.type, c.encoding, c.schema_encoding) for c in McapFile(path).channels} == {
        ("foxglove.PointCloud", "protobuf", "protobuf")
    }
    path = write_mcap(tmp_path / "b.mcap", flight(2), encoding="json", schema="")
    assert {(c.type, c.encoding, c.schema, c.schema_encoding) for c in McapFile(path).channels} == {
        ("", "json", b"", "")
    }
    assert len(content(McapFile(path))) == 2


def test_channels_of_one_name_that_differ_stay_apart(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as stream:
        writer: Any = McapWriter(stream)
        writer.start()
        schema = writer.register_schema(STRING, "ros2msg", b"string data")
        for encoding, data in (("cdr", b"one"), ("json", b"two")):
            writer.add_message(writer.register_channel("/a", encoding, schema), 5, data, 5)
        writer.finish()
    file = McapFile(path)
    assert [(c.topic, c.encoding, c.count) for c in file.channels] == [
        ("/a", "cdr", 1), ("/a", "json", 1),
    ]  # fmt: skip
    assert [(m.channel.encoding, m.data) for m in file.messages(["/a"])] == [
        ("cdr", b"one"), ("json", b"two"),
    ]  # fmt: skip


def test_messages_that_ros_2_compressed_are_decompressed(tmp_path: Path) -> None:
    messages = [m._replace(data=b"\0\1\0\0" + m.data) for m in flight()]
    packed = [m._replace(data=zstandard.compress(m.data)) for m in messages]
    packed[3] = packed[3]._replace(data=packed[3].data[:50])
    file = McapFile(write_mcap(tmp_path / "a.mcap", packed))
    assert content(file) == messages[:3] + messages[4:]
    assert "lost: 1 message (1 of /b), 50 bytes" in file.losses[0]


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
def test_a_chunk_that_the_end_cuts_is_no_damage_in_the_middle(tmp_path: Path, share: float) -> None:
    path = write_mcap(tmp_path / "a.mcap", flight(400), chunk_size=10**7)
    data = path.read_bytes()
    ((begin, end),) = mcap_records(data, Opcode.CHUNK)
    size = begin + int(share * (end - begin))
    path.write_bytes(data[:size])

    file = McapFile(path)
    whole = content(file)
    assert len(whole) > 0.9 * share * 400
    # What is there of the next message is lost as well. Before the records stand 49 bytes.
    at = stop = begin + 49
    while stop <= size:
        at, stop = stop, stop + 9 + struct.unpack_from("<Q", data, stop + 1)[0]
    lost = end - at
    assert file.losses == [f"{path}: breaks off at byte {begin:,}; lost: {lost:,} bytes"]


@pytest.mark.parametrize("short", [3, 2000])
def test_damage_in_the_chunk_that_the_end_cuts_is_lost_with_it(tmp_path: Path, short: int) -> None:
    messages = flight(60)
    path = write_mcap(tmp_path / "a.mcap", messages, "zstd")
    data = bytearray(path.read_bytes())
    begin, end = mcap_records(data, Opcode.CHUNK)[-1]
    data[begin + (end - begin) // 3] ^= 0xFF
    path.write_bytes(data[: end - short])
    file = McapFile(path)

    found = content(file)

    assert found == messages[: len(found)]
    assert len(found) < 50
    # All of the chunk, but for the fields before its content.
    assert file.losses[0].endswith(f"lost: {end - begin - 53:,} bytes")


def test_an_index_that_the_end_cuts_costs_no_message(tmp_path: Path) -> None:
    path = write_mcap(tmp_path / "a.mcap", flight(400), chunk_size=10**7)
    data = path.read_bytes()
    ((_, end),) = mcap_records(data, Opcode.CHUNK)
    path.write_bytes(data[: end + 30])

    file = McapFile(path)
    assert content(file) == flight(400)
    (loss,) = file.losses
    assert loss.startswith(f"{path}: breaks off at byte {end:,}, after 1 chunk; lost: ")
    assert "message" not in loss


@COMPRESSIONS
def test_each_pass_says_the_same_of_a_damaged_chunk(tmp_path: Path, compression: str) -> None:
    plainest: dict[str, Any] = {"index_types": IndexType.NONE, "use_statistics": False}
    for options in ({}, plainest):
        path = write_mcap(tmp_path / "a.mcap", flight(), compression, **options)
        data = bytearray(path.read_bytes())
        start, end = mcap_records(data, Opcode.CHUNK)[4]
        data[(start + end) // 2] ^= 4
        path.write_bytes(data)
        lines = list[str]()
        for topics in (["/a"], ["/b"], None):
            file = McapFile(path)
            content(file, topics)
            lines += file.losses
        assert len(lines) == 3
        assert len(set(lines)) == 1
        assert "of /a" in lines[0]
        assert "of /b" in lines[0]


@COMPRESSIONS
def test_a_topic_is_read_without_the_chunks_that_do_not_hold_it(
    tmp_path: Path, compression: str
) -> None:
    messages = [*flight(60, topics=["/a"]), Sent("/b", 99 * SECOND, b"b" * 5000)]
    path = write_mcap(tmp_path / "a.mcap", messages, compression)
    data = bytearray(path.read_bytes())
    for start, end in mcap_records(data, Opcode.CHUNK)[:-1]:
        data[start + 60 : end] = bytes(end - start - 60)
    path.write_bytes(data)
    file = McapFile(path)
    assert content(file, ["/b"]) == messages[-1:]
    assert file.losses == []
    assert len(content(file)) < 20
    assert file.losses


@pytest.mark.parametrize("form", ["chunks", "no summary"])
@COMPRESSIONS
def test_a_damaged_chunk_loses_just_that_chunk(tmp_path: Path, compression: str, form: str) -> None:
    messages = flight()
    path = write_mcap(tmp_path / "a.mcap", messages, compression, **FORMS[form])
    data = bytearray(path.read_bytes())
    places = mcap_records(data, Opcode.CHUNK)
    assert len(places) > 8
    # A bit in the middle of its content, which nothing but the checksum tells when it is plain.
    start, end = places[4]
    data[(start + end) // 2] ^= 4
    path.write_bytes(data)
    file = McapFile(path)
    found = content(file)
    lost = [message for message in messages if message not in found]
    first = messages.index(lost[0])
    assert 0 < len(lost) < 20
    assert messages[:first] + messages[first + len(lost) :] == found
    assert file.losses[0].startswith(f"{path}: the chunk at byte {start:,} is damaged")
    if form == "chunks":
        seconds = (lost[-1].log_time - lost[0].log_time) / SECOND
        assert f"lost: {len(lost)} messages ({told(lost)}), {seconds:.3f} s" in file.losses[0]


@pytest.mark.parametrize("form", ["chunks", "no summary"])
def test_after_a_chunk_of_a_wrong_length_reading_goes_on(tmp_path: Path, form: str) -> None:
    messages = flight()
    path = write_mcap(tmp_path / "a.mcap", messages, "zstd", **FORMS[form])
    whole = path.read_bytes()
    start, _ = mcap_records(whole, Opcode.CHUNK)[4]
    for length in (0, 77, 50_000, 1 << 40, (1 << 64) - 1):
        data = bytearray(whole)
        struct.pack_into("<Q", data, start + 1, length)
        path.write_bytes(data)
        with allocating_less_than(3_000_000):
            found = content(file := McapFile(path))
        assert len(messages) - 20 < len(found) < len(messages)
        assert found == [message for message in messages if message in found]
        assert file.losses


def test_a_summary_with_a_wrong_checksum_is_not_believed(tmp_path: Path) -> None:
    messages = flight(40)
    path = write_mcap(tmp_path / "a.mcap", messages)
    whole = path.read_bytes()
    ((_, summary),) = mcap_records(whole, Opcode.DATA_END)
    for at in range(summary, len(whole) - 8, 5):
        data = bytearray(whole)
        data[at] ^= 0x11
        path.write_bytes(data)
        file = McapFile(path)
        assert file.time_span == (SECOND, 40 * SECOND)
        assert [(c.topic, c.type, c.count) for c in file.channels] == [
            ("/a", STRING, 20), ("/b", STRING, 20),
        ]  # fmt: skip
        assert content(file) == messages
        assert file.losses == []


def test_damage_beside_a_chunk_that_the_summary_knows_leaves_the_chunk(tmp_path: Path) -> None:
    messages = flight()
    path = tmp_path / "a.mcap"
    with path.open("wb") as stream:
        writer: Any = McapWriter(stream, chunk_size=4096, compression=CompressionType.NONE)
        writer.start()
        number = writer.register_channel("/a", "cdr", 0)
        for at, message in enumerate(messages):
            if at == 60:
                writer.add_metadata("between", {"two": "chunks"})
            writer.add_message(number, message.log_time, message.data, message.log_time)
        writer.finish()
    data = bytearray(path.read_bytes())
    ((start, _),) = mcap_records(data, Opcode.METADATA)
    struct.pack_into("<Q", data, start + 1, 1 << 50)
    path.write_bytes(data)
    file = McapFile(path)
    assert [message.data for message in file.messages()] == [message.data for message in messages]
    assert "is damaged" in file.losses[0]


def test_after_a_message_of_a_wrong_length_reading_goes_on(tmp_path: Path) -> None:
    messages = flight()
    path = write_mcap(tmp_path / "a.mcap", messages, **FORMS["no chunks"])
    whole = path.read_bytes()
    start, _ = mcap_records(whole, Opcode.MESSAGE)[50]
    for length in (3, 25, 5000, 1 << 50):
        data = bytearray(whole)
        struct.pack_into("<Q", data, start + 1, length)
        path.write_bytes(data)
        found = content(file := McapFile(path))
        assert len([message for message in found if message in messages]) >= len(messages) - 3
        assert file.losses


def test_a_chunk_that_claims_to_be_huge_costs_no_more_than_the_file(tmp_path: Path) -> None:
    messages = flight()
    for compression in ("zstd", "lz4"):
        path = write_mcap(tmp_path / "a.mcap", messages, compression, **FORMS["no summary"])
        data = bytearray(path.read_bytes())
        start, _ = mcap_records(data, Opcode.CHUNK)[2]
        for size in (1 << 31, 1 << 62):
            struct.pack_into("<Q", data, start + 9 + 16, size)
            path.write_bytes(data)
            with allocating_less_than(3_000_000):
                found = content(file := McapFile(path))
            assert len(messages) - 20 < len(found) < len(messages)
            assert file.losses


@pytest.mark.parametrize("name", ["ros1_ouster_in_mcap_zstd", "ros2_nav2_turtlebot"])
def test_a_recorded_file_cut_anywhere_yields_what_lies_whole(
    shared_data: Path, tmp_path: Path, name: str
) -> None:
    path = shared_data / "bags" / f"{name}.mcap"
    check_every_cut(path, tmp_path, McapFile, whole_in_mcap(path), places=12)


@pytest.mark.parametrize("form", ["chunks", "no chunks", "no summary"])
@COMPRESSIONS
def test_a_written_file_cut_anywhere_yields_what_lies_whole(
    tmp_path: Path, compression: str, form: str
) -> None:
    (tmp_path / "cut").mkdir()
    path = write_mcap(tmp_path / "a.mcap", flight(60), compression, **FORMS[form])
    check_every_cut(path, tmp_path / "cut", McapFile, whole_in_mcap(path), places=40)


def test_of_a_plain_chunk_that_is_cut_the_messages_before_the_cut_are_read(tmp_path: Path) -> None:
    messages = flight()
    path = write_mcap(tmp_path / "a.mcap", messages, chunk_size=10**7)
    data = path.read_bytes()
    for number in (10, 70):
        end = data.index(messages[number].data) + len(messages[number].data)
        path.write_bytes(data[:end])
        assert content(McapFile(path)) == messages[: number + 1]
        path.write_bytes(data[: end - 1])
        assert content(McapFile(path)) == messages[:number]


@pytest.mark.parametrize("form", ["chunks", "no chunks", "no summary"])
def test_rotten_bits_end_in_no_worse_than_a_loss(tmp_path: Path, form: str) -> None:
    (tmp_path / "rot").mkdir()
    path = write_mcap(tmp_path / "a.mcap", flight(60), "zstd", **FORMS[form])
    check_bit_rot(path, tmp_path / "rot", McapFile, rounds=100)


def test_a_file_without_messages_has_no_times(tmp_path: Path) -> None:
    file = McapFile(write_mcap(tmp_path / "a.mcap", []))
    assert file.time_span is None
    assert content(file) == []
    assert file.losses == []


@pytest.mark.parametrize(("head", "words"), [(b"", "is empty"), (b"\x89MCAPx\r\n", "expected")])
def test_what_is_no_mcap_is_refused(tmp_path: Path, head: bytes, words: str) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(head)
    assert words in refusal(open_container, path)
    assert words in refusal(McapFile, path)


def test_the_writer_of_the_tests_compresses(tmp_path: Path) -> None:
    # Else the tests of compression say nothing.
    assert {CompressionType.ZSTD, CompressionType.LZ4, CompressionType.NONE} == set(CompressionType)
    messages = [m._replace(data=bytes(500)) for m in flight()]
    sizes = {
        compression: write_mcap(tmp_path / compression, messages, compression).stat().st_size
        for compression in ("none", "lz4", "zstd")
    }
    assert sizes["none"] > 2 * sizes["lz4"]
    assert sizes["none"] > 2 * sizes["zstd"]


def test_an_index_that_leads_back_to_its_own_chunk_is_not_followed() -> None:
    # Taken at its word, such a chunk ends where it begins, and the next one is itself.
    index = ChunkIndex(
        chunk_length=0,
        chunk_start_offset=100,
        compressed_size=0,
        compression="",
        message_end_time=0,
        message_index_length=0,
        message_index_offsets={1: 85},
        message_start_time=0,
        uncompressed_size=0,
    )
    assert chunk_by_index(index) is None
