"""ROS 1 bags: whole, unsorted, unindexed, cut, rotten.

Ways to pass without being right: what is read is compared with what the same reader reads; a
damaged bag that yields nothing at all; a loss that is told although nothing is missing; chunks
sorted by where they begin but not merged; the whole bag held to sort it.
"""

from __future__ import annotations

import random
import struct
from pathlib import Path

import pytest

from mlscli.io.containers.opening import open_container
from mlscli.io.containers.ros1bag import Ros1Bag
from tests.helpers.broken import (
    SECOND,
    Sent,
    allocating_less_than,
    by_anyreader,
    check_bit_rot,
    check_every_cut,
    content,
    flight,
    refusal,
    told,
    whole_in_ros1,
    write_ros1,
)

RECORDED = [
    "ros1_example_bz2",
    "ros1_jackal_scan_pose",
    "ros1_luminar_pc2_lz4",
    "ros1_no_messages",
    "ros1_tf_example",
    "ros1_tilt_laser_tf",
    "ros1_unsorted_chunks",
]
COMPRESSIONS = pytest.mark.parametrize("compression", ["none", "bz2", "lz4"])
INDEX_POSITION = b"index_pos="


@pytest.mark.parametrize("name", RECORDED)
def test_a_recorded_bag_reads_as_rosbags_reads_it(shared_data: Path, name: str) -> None:
    path = shared_data / "bags" / f"{name}.bag"
    bag = open_container(path)
    expected = by_anyreader(path)
    assert content(bag) == expected
    assert bag.kind == "ROS 1 bag"
    assert bag.losses == []
    times = [message.log_time for message in expected]
    assert bag.time_span == ((min(times), max(times)) if times else None)
    counts = {channel.topic: channel.count for channel in bag.channels}
    assert counts == {t: sum(m.topic == t for m in expected) for t in {m.topic for m in expected}}


def test_channels_have_ros_2_names_and_definitions(shared_data: Path) -> None:
    bag = Ros1Bag(shared_data / "bags" / "ros1_luminar_pc2_lz4.bag")
    cloud = next(channel for channel in bag.channels if channel.topic == "/luminar_pointcloud")
    assert (cloud.type, cloud.encoding, cloud.schema_encoding, cloud.count) == (
        "sensor_msgs/msg/PointCloud2", "ros1", "ros1msg", 5,
    )  # fmt: skip
    assert b"PointField[] fields" in cloud.schema


@COMPRESSIONS
@pytest.mark.parametrize("threshold", [1, 5000, 10**7])
def test_a_written_bag_reads_back(tmp_path: Path, compression: str, threshold: int) -> None:
    messages = flight()
    bag = Ros1Bag(write_ros1(tmp_path / "a.bag", messages, compression, threshold))
    assert content(bag) == messages
    assert bag.losses == []
    # Each pass begins anew, also after one that was left.
    next(bag.messages())
    assert content(bag, ["/b"]) == [message for message in messages if message.topic == "/b"]
    assert content(bag, ["/c"]) == []
    assert bag.losses == []


def test_messages_come_in_the_order_of_time_and_equal_times_in_that_of_the_file(
    tmp_path: Path,
) -> None:
    rng = random.Random(3)
    messages = [m._replace(log_time=SECOND + rng.randrange(40)) for m in flight(300)]
    assert messages != sorted(messages, key=lambda m: m.log_time)
    bag = Ros1Bag(write_ros1(tmp_path / "a.bag", messages))
    assert content(bag) == sorted(messages, key=lambda m: m.log_time)


def test_only_chunks_that_overlap_in_time_are_held(tmp_path: Path) -> None:
    # Chunks of a message of 100 kB, in an order that no neighbours keep; 24 MB in all.
    messages = [
        message._replace(log_time=(at * 37) % 240 * SECOND)
        for at, message in enumerate(flight(240, size=100_000))
    ]
    bag = Ros1Bag(write_ros1(tmp_path / "a.bag", messages, threshold=1))
    with allocating_less_than(2_000_000):
        times = [message.log_time for message in bag.messages()]
    assert times == [n * SECOND for n in range(240)]


def test_two_publishers_of_a_topic_are_one_channel(tmp_path: Path) -> None:
    messages = flight(topics=("/a", "/b"))
    path = write_ros1(tmp_path / "a.bag", messages)
    path.write_bytes(path.read_bytes().replace(b"topic=/b", b"topic=/a"))
    bag = Ros1Bag(path)
    assert [(channel.topic, channel.count) for channel in bag.channels] == [("/a", len(messages))]
    assert [m.data for m in content(bag)] == [m.data for m in messages]


def test_an_unindexed_bag_is_read_whole_and_the_missing_index_told(shared_data: Path) -> None:
    bag = Ros1Bag(shared_data / "hard" / "ros1_unindexed.bag")
    # What rosbags counts once it is given an index: 73 + 73 + 29 (see the indexes of its chunks).
    assert len(content(bag)) == 175
    assert [(c.topic, c.count) for c in bag.channels] == [("pointcloud2d", 175)]
    assert "was not closed" in bag.losses[0]


@COMPRESSIONS
def test_without_its_index_a_bag_reads_as_with_it(tmp_path: Path, compression: str) -> None:
    messages = flight()
    path = write_ros1(tmp_path / "a.bag", messages, compression)
    data = bytearray(path.read_bytes())
    at = data.index(INDEX_POSITION) + len(INDEX_POSITION)
    (index,) = struct.unpack_from("<Q", data, at)
    struct.pack_into("<Q", data, at, 0)
    path.write_bytes(data[:index])
    bag = Ros1Bag(path)
    assert content(bag) == messages
    assert len(bag.losses) == 1


@pytest.mark.parametrize("name", RECORDED)
def test_a_recorded_bag_cut_anywhere_yields_what_lies_whole(
    shared_data: Path, tmp_path: Path, name: str
) -> None:
    path = shared_data / "bags" / f"{name}.bag"
    check_every_cut(path, tmp_path, Ros1Bag, whole_in_ros1(path), places=12)


@COMPRESSIONS
def test_a_written_bag_cut_anywhere_yields_what_lies_whole(
    tmp_path: Path, compression: str
) -> None:
    (tmp_path / "cut").mkdir()
    path = write_ros1(tmp_path / "a.bag", flight(), compression)
    check_every_cut(path, tmp_path / "cut", Ros1Bag, whole_in_ros1(path), places=60)


@COMPRESSIONS
def test_rotten_bits_end_in_no_worse_than_a_loss(tmp_path: Path, compression: str) -> None:
    (tmp_path / "rot").mkdir()
    path = write_ros1(tmp_path / "a.bag", flight(), compression)
    check_bit_rot(path, tmp_path / "rot", Ros1Bag, rounds=100)


def chunks(data: bytes | bytearray) -> list[int]:
    """Return where the headers of chunks hold their compression."""
    found, at = [], -1
    while (at := data.find(b"compression=", at + 1)) >= 0:
        found.append(at)
    return found


@pytest.mark.parametrize("compression", ["bz2", "lz4"])
def test_a_damaged_chunk_loses_just_that_chunk(tmp_path: Path, compression: str) -> None:
    messages = flight()
    path = write_ros1(tmp_path / "a.bag", messages, compression)
    data = bytearray(path.read_bytes())
    places = chunks(data)
    assert len(places) > 8
    # The content of the fifth begins after the rest of its header and the length of its data.
    for at in range(places[4] + 60, places[4] + 90):
        data[at] ^= 0xFF
    path.write_bytes(data)
    bag = Ros1Bag(path)
    found = content(bag)
    lost = [message for message in messages if message not in found]
    assert 0 < len(lost) < 20
    assert [m for m in messages if m not in lost] == found
    # They lie in a row.
    first = messages.index(lost[0])
    assert messages[first : first + len(lost)] == lost
    seconds = (lost[-1].log_time - lost[0].log_time) / SECOND
    assert f"lost: {len(lost)} messages ({told(lost)}), {seconds:.3f} s" in bag.losses[0]
    assert str(path) in bag.losses[0]
    # What is not asked for is not told.
    assert content(bag, ["/none"]) == []
    assert bag.losses == []


def test_of_a_plain_chunk_the_messages_before_its_damage_are_read(tmp_path: Path) -> None:
    messages = flight(40)
    path = write_ros1(tmp_path / "a.bag", messages, threshold=10**7)
    data = bytearray(path.read_bytes())
    # The length of the header of a record: a header of 38 bytes, and a length, precede the data.
    at = data.index(messages[25].data) - 4 - 38 - 4
    assert struct.unpack_from("<I", data, at) == (38,)
    struct.pack_into("<I", data, at, 1 << 30)
    path.write_bytes(data)
    bag = Ros1Bag(path)
    assert content(bag) == messages[:25]
    assert "is damaged: no record is at its byte" in bag.losses[0]
    assert "lost: 15 messages" in bag.losses[0]


def test_a_cut_between_the_indexes_of_a_chunk_hides_no_topic(tmp_path: Path) -> None:
    messages = flight()
    path = write_ros1(tmp_path / "a.bag", messages, "lz4")
    data = path.read_bytes()
    # The last chunk has an index for each of the two topics.
    last = data.rindex(b"op=\4")
    before = data.rindex(b"op=\4", 0, last)
    end = data.rindex(struct.pack("<I", 47), 0, last)
    assert before < end < last
    path.write_bytes(data[:end])
    bag = Ros1Bag(path)
    for topic in ("/a", "/b"):
        assert content(bag, [topic]) == [m for m in messages if m.topic == topic]
    assert bag.losses


@pytest.mark.parametrize("place", [b"compression=", b"size="])
def test_after_a_chunk_without_a_header_reading_goes_on(tmp_path: Path, place: bytes) -> None:
    messages = flight()
    path = write_ros1(tmp_path / "a.bag", messages, "lz4")
    data = path.read_bytes()
    at = chunks(data)[3]
    path.write_bytes(data[: at - 40] + data[at - 40 :].replace(place, b"x" * len(place), 1))
    found = content(bag := Ros1Bag(path))
    assert 100 < len(found) < len(messages)
    assert found == [message for message in messages if message in found]
    assert bag.losses


def test_a_chunk_that_claims_to_be_huge_costs_no_more_than_the_file(tmp_path: Path) -> None:
    messages = flight()
    path = write_ros1(tmp_path / "a.bag", messages, "lz4")
    data = bytearray(path.read_bytes())
    at = data.index(b"size=", chunks(data)[2] - 40) + 5
    struct.pack_into("<I", data, at, 0xFFFFFFFF)
    path.write_bytes(data)
    with allocating_less_than(3_000_000):
        found = content(bag := Ros1Bag(path))
    assert len(messages) - 20 < len(found) < len(messages)
    assert "claims 4,294,967,295" in bag.losses[0]


def test_a_record_that_claims_to_be_huge_costs_no_more_than_the_file(tmp_path: Path) -> None:
    path = write_ros1(tmp_path / "a.bag", flight())
    for at in (13, 4117, 4117 + 4 + 41):
        data = bytearray(path.read_bytes())
        struct.pack_into("<I", data, at, 0xFFFFFFF0)
        (tmp_path / "b.bag").write_bytes(data)
        with allocating_less_than(3_000_000):
            assert content(bag := Ros1Bag(tmp_path / "b.bag"))
        assert bag.losses


@pytest.mark.parametrize(
    ("head", "words"),
    [
        (b"", "is empty"),
        (b"#ROSBAG V1.2\nabc", "the tools of ROS 1 convert"),
        (b"#ROSRECORD V1.1\n", "the tools of ROS 1 convert"),
        (b"x,y,z\n1,2,3\n", "expected a ROS 1 bag"),
    ],
)
def test_what_is_no_bag_is_refused(tmp_path: Path, head: bytes, words: str) -> None:
    path = tmp_path / "a.bag"
    path.write_bytes(head)
    assert words in refusal(open_container, path)


def test_an_encrypted_bag_is_refused(tmp_path: Path) -> None:
    fields = b"".join(
        struct.pack("<I", len(field)) + field
        for field in (
            b"op=\3", b"index_pos=" + bytes(8), b"conn_count=" + bytes(4),
            b"chunk_count=" + bytes(4), b"encryptor=rosbag/AesCbcEncryptor",
        )
    )  # fmt: skip
    path = tmp_path / "a.bag"
    path.write_bytes(
        b"#ROSBAG V2.0\n"
        + struct.pack("<I", len(fields))
        + fields
        + struct.pack("<I", 9)
        + b" " * 9
    )
    assert "rosbag/AesCbcEncryptor" in refusal(open_container, path)


def test_an_index_that_lies_about_a_connection_is_told(tmp_path: Path) -> None:
    messages = [*flight(40), Sent("/late", 90 * SECOND, b"late")]
    path = write_ros1(tmp_path / "a.bag", messages, "lz4")
    # Of the connections, the last at the end of the file loses its record; its chunk is damaged.
    data = bytearray(path.read_bytes())
    at = chunks(data)[-1] + 60
    data[at : at + 10] = bytes(10)
    path.write_bytes(data)
    bag = Ros1Bag(path)
    assert "/late" in {channel.topic for channel in bag.channels}
    assert content(bag, ["/late"]) == []
    assert ", 1 of /late)" in bag.losses[0]
