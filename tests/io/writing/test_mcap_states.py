"""Files of states, read back by mcap and rosbags.

Ways to pass without being right: states that compress well alone, so random ones are repeated;
one chunk for everything, so the limit is lowered until there are many; a reader that ignores
checksums and indexes, so mcap's checks them and the last state is found by the index alone.
"""

from __future__ import annotations

from pathlib import Path

import hypothesis.strategies as st
import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from mlscli.io.writing import mcap_states
from mlscli.io.writing.mcap_states import StateWriter

STORE = get_typestore(Stores.ROS2_JAZZY)
TEXT = "std_msgs/msg/String"
WINDOW_OF_ALL_DECODERS = 2**27

Written = list[tuple[str, int, bytes]]


def write(path: Path, messages: Written) -> None:
    with StateWriter(path, STORE) as bag:
        numbers = {topic: bag.add_topic(topic, TEXT, {}) for topic in ("/first", "/a", "/b")}
        for topic, stamp, data in messages:
            bag.write(numbers[topic], stamp, data)


def read(path: Path) -> Written:
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        return [(c.topic, m.log_time, m.data) for _, c, m in reader.iter_messages()]


def chunks(path: Path) -> list[Chunk]:
    with path.open("rb") as stream:
        records = StreamReader(stream, emit_chunks=True).records
        return [record for record in records if isinstance(record, Chunk)]


def text(words: bytes) -> bytes:
    return bytes(STORE.serialize_cdr(STORE.types[TEXT](data=words.hex()), TEXT))


@settings(max_examples=35, deadline=None)
@given(
    messages=st.lists(
        st.tuples(
            st.sampled_from(["/first", "/a", "/b"]), st.integers(1, 9), st.binary(max_size=80)
        )
    ),
    limit=st.integers(1, 400),
)
def test_each_topic_is_read_back_as_it_was_written(
    tmp_path_factory: pytest.TempPathFactory, messages: Written, limit: int
) -> None:
    path = tmp_path_factory.mktemp("states") / "a.mcap"
    messages.sort(key=lambda message: message[1])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mcap_states, "CHUNK_BYTES", limit)
        patch.setattr(mcap_states, "_SMALL_BYTES", limit // 8)
        write(path, messages)
    found = read(path)
    assert [stamp for _, stamp, _ in found] == [stamp for _, stamp, _ in messages]
    for topic in ("/first", "/a", "/b"):
        assert [m for m in found if m[0] == topic] == [m for m in messages if m[0] == topic]


def test_rosbags_reads_it_too(tmp_path: Path) -> None:
    write(tmp_path / "a.mcap", [("/a", 5, text(b"one")), ("/b", 6, text(b"two"))])
    with AnyReader([tmp_path / "a.mcap"]) as reader:
        told = [
            (connection.topic, time, reader.deserialize(data, TEXT).data)  # type: ignore[attr-defined]
            for connection, time, data in reader.messages()
        ]
    assert told == [("/a", 5, b"one".hex()), ("/b", 6, b"two".hex())]


def test_a_state_like_the_one_before_costs_little(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    a, b = (bytearray(rng.bytes(1_000_000)) for _ in range(2))
    messages = []
    for stamp in range(1, 21):
        a[rng.integers(len(a))] ^= 1
        messages += [("/a", stamp, bytes(a)), ("/b", stamp, bytes(b))]
    write(tmp_path / "a.mcap", messages)
    assert read(tmp_path / "a.mcap") == messages
    assert (tmp_path / "a.mcap").stat().st_size < 1.05 * (len(a) + len(b))


def test_every_decoder_may_open_its_chunks(tmp_path: Path) -> None:
    data = np.random.default_rng(1).bytes(3 * 2**20)
    write(tmp_path / "a.mcap", [("/a", stamp, data) for stamp in range(40)])
    found = chunks(tmp_path / "a.mcap")
    assert len(found) == 2
    for chunk in found:
        frame = zstandard.get_frame_parameters(chunk.data)
        assert frame.window_size <= WINDOW_OF_ALL_DECODERS
        assert frame.content_size == chunk.uncompressed_size <= mcap_states.CHUNK_BYTES
        assert frame.has_checksum


def test_what_is_small_and_told_first_stands_first(tmp_path: Path) -> None:
    data = np.random.default_rng(1).bytes(40 * 2**20)
    messages = []
    for stamp in (1, 2, 3):
        messages += [("/first", stamp, b"small"), ("/a", stamp, data)]
    write(tmp_path / "a.mcap", messages)
    assert [m[:2] for m in read(tmp_path / "a.mcap")] == [m[:2] for m in messages]


def test_a_file_that_was_not_finished_has_no_summary(tmp_path: Path) -> None:
    def fail() -> None:
        with StateWriter(tmp_path / "a.mcap", STORE) as bag:
            bag.write(bag.add_topic("/a", TEXT, {}), 1, b"state")
            raise RuntimeError("on the way")

    with pytest.raises(RuntimeError, match="on the way"):
        fail()
    assert (tmp_path / "a.mcap").read_bytes().count(mcap_states.MAGIC) == 1
