"""The last message alone.

How these tests could be cheated: by the last keyframe instead of the last message, by the last
message whatever was selected, by decoding or keeping all of them, by calling the earlier points
dropped or forgetting where the craft was, or by an error where the last one is broken. So messages
hold several keyframes and parts, decoded ones are counted, and selections end before the end.
"""

from __future__ import annotations

import json
from base64 import b64encode
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer

from mlscli.errors import InputError, UsageError
from mlscli.io.messages.topic import TopicSource
from mlscli.io.reading.glance import Glance
from mlscli.io.reading.recording import Recording, open_recording
from tests.helpers.bags import Sent, Told, write_bag, write_told
from tests.helpers.craft import BEGIN, POINTS, cloud, head, log_time, moving, opened
from tests.helpers.keyframes import xs
from tests.helpers.ros import vector
from tests.helpers.texts import text

SECOND = 10**9


def maps(count: int = 6, begin: int = 0) -> list[Sent]:
    """Return messages a second apart; the k-th has k + 1 points, all at x = k."""
    return [Sent(np.full((k + 1, 3), float(k)), k * SECOND) for k in range(begin, begin + count)]


@pytest.fixture
def decoded(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """Return a list that receives the messages that are decoded."""
    seen: list[object] = []
    decode = TopicSource._decode

    def counted(self: TopicSource, message: Any) -> Any:
        seen.append(message)
        return decode(self, message)

    monkeypatch.setattr(TopicSource, "_decode", counted)
    return seen


@pytest.mark.parametrize("kind", ["ros1", "ros2", "mcap"])
@pytest.mark.parametrize("type_", ["sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/PointCloud"])
def test_the_last_message_is_read_and_no_other(
    tmp_path: Path, decoded: list[object], kind: str, type_: str
) -> None:
    bag = write_bag(tmp_path / "bag", maps(), kind, message_type=type_)
    recording = open_recording(bag, latest=True)
    for _ in range(2):
        decoded.clear()
        (keyframe,) = recording.keyframes()
        assert len(decoded) == 1
        assert keyframe.points.tolist() == [[5, 5, 5]] * 6
        assert keyframe.stamp == 5
        assert (recording.tally.points_read, recording.tally.keyframes) == (6, 1)
        assert recording.tally.dropped == {}
    assert recording.options == {"latest": True}
    assert "`latest`: the last message alone is taken, of 6" in recording.notes


@pytest.mark.parametrize(
    ("options", "last", "of"),
    [
        ({"end": 3.0}, 3, 4),
        ({"start": 2.0}, 5, 4),
        ({"every": 2}, 4, 3),
        ({"every": 5}, 5, 2),
        ({"every": 9}, 0, 1),
        ({"start": 1.0, "end": 4.0, "every": 2}, 3, 2),
    ],
)
def test_it_is_the_last_of_the_selection(
    tmp_path: Path, options: dict[str, Any], last: int, of: int
) -> None:
    recording = open_recording(write_bag(tmp_path / "bag", maps()), latest=True, **options)
    assert xs(recording) == [last] * (last + 1)
    assert any(note.endswith(f"alone is taken, of {of}") for note in recording.notes)


def test_crop_and_up_are_those_of_any_cloud(tmp_path: Path) -> None:
    sent = [Sent(np.array([[0.0, 1.0, 2.0], [5.0, 1.0, 2.0]]), k) for k in range(3)]
    recording = open_recording(
        write_bag(tmp_path / "bag", sent), latest=True, up="-y", crop=(-1, 1, -9, 9, -9, 9)
    )
    (keyframe,) = recording
    assert keyframe.points.tolist() == [[0, 2, -1]]
    assert recording.tally.points_read == 2
    assert recording.tally.dropped == {"outside the crop": 1}


def test_all_keyframes_of_the_last_message_are_taken(tmp_path: Path) -> None:
    sent = [Sent(np.arange(12.0).reshape(4, 3) + k, k, labels=[7, 7, 2, 7]) for k in range(3)]
    recording = open_recording(write_bag(tmp_path / "bag", sent), latest=True, every=2)
    assert [k.points[:, 0].tolist() for k in recording] == [[2, 5, 11], [8]]


def test_of_several_sources_it_is_the_last_message_of_all(tmp_path: Path) -> None:
    one, two = (write_bag(tmp_path / str(n), maps(3, 3 * n)) for n in (0, 1))
    assert xs(open_recording(one, two, latest=True)) == [5] * 6
    assert xs(open_recording(one, two, latest=True, end=2.0)) == [2] * 3
    assert xs(open_recording(one, two, latest=True, every=2)) == [4] * 5


def marked(seconds: float, xs: list[float]) -> Told:
    """Return markers with one point each, of which each has a time and a frame of its own."""
    listed = [
        {
            "header": head(seconds + number / 1000, "map"),
            "id": number,
            "type": 8,
            "pose": {"orientation": vector(0, 0, 0, 1)},
            "points": [vector(x, 0, 0)],
        }
        for number, x in enumerate(xs)
    ]
    type_ = "visualization_msgs/msg/MarkerArray"
    return Told("/markers", type_, {"markers": listed}, log_time(seconds))


def test_markers_without_a_common_time_are_one_message(tmp_path: Path) -> None:
    told = [marked(k, [10.0 * k, 10.0 * k + 1, 10.0 * k + 2]) for k in range(4)]
    recording = opened(tmp_path, [*told, marked(4, [])], latest=True)
    assert xs(recording) == [30, 31, 32]
    assert xs(open_recording(tmp_path / "flight", latest=True, end=2.5)) == [20, 21, 22]
    assert xs(open_recording(tmp_path / "flight", latest=True, every=2)) == [20, 21, 22]


def test_a_last_message_that_is_broken_is_a_loss_and_the_one_before_is_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def sent(k: int, size: int) -> Told:
        fields = [
            {"name": n, "offset": 4 * i, "datatype": 7, "count": 1} for i, n in enumerate("xyz")
        ]
        data = np.full(3 * size, k, dtype="<f4").view(np.uint8)
        content = {
            "header": head(k, "map"), "height": 1, "width": 2, "fields": fields, "point_step": 12,
            "row_step": 24, "data": data,
        }  # fmt: skip
        return Told("/cloud", "sensor_msgs/msg/PointCloud2", content, log_time(k))

    # A message that says it holds two points, and holds but one.
    sizes = [2, 2, 1, 2, 1, 1]
    write_told(tmp_path / "flight", [sent(k, size) for k, size in enumerate(sizes)], "mcap")
    for end, last, lost in ((9.0, 3, "3 of 6"), (2.0, 1, "1 of 6"), (3.0, 3, "")):
        recording = open_recording(tmp_path / "flight", latest=True, end=end)
        assert xs(recording) == [last, last]
        assert [lost in loss for loss in recording.losses] == [True] * bool(lost)
    with pytest.raises(InputError, match=r"holds no keyframes.*2 of 6 messages cannot be read"):
        xs(open_recording(tmp_path / "flight", latest=True, start=3.5))
    # What can be read is sought among the messages selected, not to the end.
    recording = open_recording(tmp_path / "flight", latest=True, end=2.0)
    came, messages = [], TopicSource._messages

    def counted(self: TopicSource, *of: Any) -> Any:
        for message in messages(self, *of):
            came.append(message)
            yield message

    monkeypatch.setattr(TopicSource, "_messages", counted)
    assert xs(recording) == [1, 1]
    assert len(came) == 6 + 3


def test_a_last_message_without_points_is_an_error_that_says_what_helps(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", [*maps(3), Sent(np.empty((0, 3)), 9 * SECOND)])
    words = r"holds no points; it is the last message of 4, `end` takes others$"
    with pytest.raises(InputError, match=words):
        xs(open_recording(bag, latest=True))
    assert xs(open_recording(bag, latest=True, end=8.0)) == [2] * 3


def test_what_has_no_messages_is_refused(tmp_path: Path) -> None:
    bag, cloud = write_bag(tmp_path / "bag", maps()), text(tmp_path, "1 2 3 0\n4 5 6 1\n")
    for sources in ((cloud,), (bag, cloud), (np.ones((2, 3)),)):
        with pytest.raises(UsageError, match=r"^`latest`: .+ \((text cloud|array)\) holds no mess"):
            open_recording(*sources, latest=True)
    with pytest.raises(UsageError, match=r"^`latest`: does not go with `cumulative`"):
        open_recording(bag, latest=True, cumulative=True)


# The craft


def rows(recording: Recording) -> list[tuple[int, float, bool]]:
    """Return of each keyframe its number of points, its time and whether its place is known."""
    return [
        (len(keyframe.points), keyframe.stamp - BEGIN, bool(np.isfinite(keyframe.position).all()))
        for keyframe in recording
    ]


def test_the_route_leads_past_all_messages_and_the_map_was_seen_from_everywhere(
    tmp_path: Path,
) -> None:
    flight = opened(tmp_path, [*moving(), *(cloud(t, "map") for t in (0, 1, 4, 9))], latest=True)
    # After the last transform nothing is known.
    assert rows(flight) == [(0, 0, True), (0, 1, True), (0, 4, True), (3, 9, False)]
    whole = open_recording(tmp_path / "flight")
    places = [k.position for k in whole][:3]
    assert [k.position for k in flight][:3] == places
    assert flight.tally.keyframes == 1


def test_a_scan_has_been_seen_from_where_the_craft_was(tmp_path: Path) -> None:
    flight = opened(
        tmp_path, [*moving(), cloud(0, "base_link"), cloud(1, "base_link")], latest=True
    )
    assert rows(flight) == [(0, 0, True), (0, 1, True), (3, 1, True)]


def test_a_trajectory_that_is_known_from_elsewhere_is_the_route(tmp_path: Path) -> None:
    route = text(tmp_path, f"{BEGIN} 1 2 3 0 0 0 1\n{BEGIN + 2} 3 2 3 0 0 0 1\n", "route.txt")
    flight = opened(tmp_path, [cloud(t, "map") for t in (0, 1, 2)], latest=True, route=route)
    assert [k.position[0] for k in flight][:3] == [1, 2, 3]
    loose = text(tmp_path, "1 1 2 3 0 0 0 1\n2 3 2 3 0 0 0 1\n", "loose.txt")
    flight = open_recording(tmp_path / "flight", latest=True, route=loose)
    assert [len(k.points) for k in flight] == [len(POINTS), 0, 0]


def test_the_vertical_is_that_of_the_last_message(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    floor = np.c_[rng.uniform(0, 4, (600, 2)), rng.normal(0, 0.01, 600)]
    wall = np.c_[np.zeros(1200), rng.uniform(0, 4, (1200, 2))]
    sent = [Sent(np.roll(floor, 1, axis=1), 0), Sent(np.r_[wall, wall + 0.01], 1), Sent(floor, 2)]
    recording = open_recording(write_bag(tmp_path / "bag", sent), latest=True, up="auto")
    (keyframe,) = recording
    assert np.ptp(keyframe.points[:, 2]) < 0.1


# A glance


def test_a_glance_ends_at_the_last_message_that_it_reaches(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", maps())
    glance = Glance(points=3, seconds=60)
    assert xs(open_recording(bag, latest=True, glance=glance)) == [5] * 6
    assert not glance.cut
    glance = Glance(points=10**6, seconds=-1)
    recording = open_recording(bag, latest=True, glance=glance)
    assert xs(recording) == []
    assert glance.cut


def test_messages_in_json_have_their_times_inside(tmp_path: Path) -> None:
    with (tmp_path / "a.mcap").open("wb") as file:
        writer: Any = Writer(file)
        writer.start()
        schema = writer.register_schema("foxglove.PointCloud", "jsonschema", b"{}")
        channel = writer.register_channel("/map", "json", schema)
        for k in range(4):
            content = {
                "timestamp": {"sec": 100 + k, "nsec": 0},
                "frame_id": "map",
                "point_stride": 12,
                "fields": [{"name": n, "offset": 4 * i, "type": 7} for i, n in enumerate("xyz")],
                "data": b64encode(np.full(6, k, dtype="<f4").tobytes()).decode(),
            }
            writer.add_message(channel, k, json.dumps(content).encode(), k)
        writer.finish()
    assert xs(open_recording(tmp_path / "a.mcap", latest=True)) == [3, 3]
    assert xs(open_recording(tmp_path / "a.mcap", latest=True, end=1.0)) == [1, 1]
