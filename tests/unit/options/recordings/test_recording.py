"""A recording of a swarm, written without a swarm, read as a world."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer as McapWriter
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from coadapt.main import main
from deploy.spec import make_spec
from options.recordings import shapes
from options.recordings.check import _apart, check
from options.recordings.clouds import read_points
from options.recordings.file import RecordingFile
from options.recordings.format import BUDGET, FUSED, LOG, Box, Budget, Fused
from options.recordings.listen import Received
from options.recordings.outlet import Outlet
from options.recordings.recorder import Recorder
from options.recordings.sink import Sink
from options.recordings.world import RecordingWorld
from options.ros.fused import Teller
from perception.fusion.aligner import Known
from perception.fusion.alignment import Estimate, correction, move_of
from swarm.errors import RecordingError, WorldError
from swarm.geometry import Matrix, invert
from swarm.messages import SceneDescription
from tests.support.message_samples import SAMPLES
from tests.support.recording_files import EPOCH_NS, detections, write_recording
from worlds.factory.world import FactoryWorld
from worlds.registry import open_world

NUMBERS = (40, 42, 46)
"""Of frames that the ego fused: at 5 Hz, without 44."""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recording")
    return write_recording(folder / "all.mcap", NUMBERS)


def test_a_recording_gives_the_scans_and_truth_that_were_there(recorded: Path) -> None:
    world, real = open_world("recording", data=recorded), FactoryWorld(robots=3, rings=16)
    assert world.robots == ("R1", "R2", "R3")
    assert (world.rate_hz, world.range_m, world.detector) == (5.0, real.range_m, "factory")
    assert world.frame_count == 4
    for frame, number in ((0, 40), (1, 42), (2, 42), (3, 46), (4, 40), (7, 46)):
        for robot in world.robots:
            scan, expected = world.scan(robot, frame), real.scan(robot, number)
            np.testing.assert_array_equal(scan.points, expected.points)
            assert scan.points.dtype == np.float32
            assert scan.pose == expected.pose == world.pose(robot, frame)
            assert scan.velocity == expected.velocity
            assert scan.frame == frame % 4
        truth, expected_truth = world.ground_truth(frame), real.ground_truth(number)
        assert truth.ids == expected_truth.ids
        assert truth.boxes.labels == expected_truth.boxes.labels
        np.testing.assert_array_equal(truth.boxes.centers, expected_truth.boxes.centers)
        np.testing.assert_array_equal(truth.boxes.headings, expected_truth.boxes.headings)
        np.testing.assert_array_equal(truth.visible_points, expected_truth.visible_points)
    with pytest.raises(WorldError, match=r"robot 'R9' is not in recording .*R1, R2, R3"):
        world.scan("R9", 0)


def test_nothing_is_seen_while_the_ego_was_down(tmp_path: Path) -> None:
    """Frames 42 and 62 are 2 s apart; the first stands in for those within 1 s."""
    world = RecordingWorld(write_recording(tmp_path / "down.mcap", (40, 42, 62)))
    assert (world.rate_hz, world.frame_count) == (5.0, 12)
    seen = [len(world.scan("R1", frame).points) > 0 for frame in range(12)]
    assert seen == [True] * 7 + [False] * 4 + [True]
    assert seen == [len(world.ground_truth(frame).boxes) > 0 for frame in range(12)]
    assert world.pose("R1", 10) == world.pose("R1", 1)


def test_every_frame_fuses_again_to_the_recorded_boxes(recorded: Path) -> None:
    result = check(RecordingWorld(recorded))
    assert (result.compared, result.equal, result.different) == (3, 3, ())
    assert result.boxes > 0
    assert result.largest < 1e-5


def test_a_frame_with_a_scan_of_another_time_is_not_compared(tmp_path: Path) -> None:
    """R2 answers for frame 42 with its scan of frame 41; for 43 its clock is 2 ms off."""
    world = FactoryWorld(robots=3, rings=16)
    late = msgspec.structs.replace(detections(world, 42), ages_ms={"R2": 100.0})
    off = msgspec.structs.replace(detections(world, 43), ages_ms={"R2": -2.0})
    result = check(RecordingWorld(write_recording(tmp_path / "late.mcap", (late, off))))
    assert (result.compared, result.equal, result.other_times) == (1, 1, 1)


@pytest.mark.parametrize("part", ["focused", "objects_only"])
def test_a_frame_of_a_part_only_is_not_compared(part: str, tmp_path: Path) -> None:
    world = FactoryWorld(robots=3, rings=16)
    some = msgspec.structs.replace(detections(world, 42), **{part: ("R2",)})
    written = write_recording(tmp_path / "places.mcap", (some, detections(world, 43)))
    result = check(RecordingWorld(written))
    assert (result.compared, result.equal, result.about_places) == (1, 1, 1)


@dataclass(frozen=True)
class Moved:
    """An ego to which all that it remembers says that R2 is off by this, in its own frame."""

    by: Matrix

    def at(self, time_s: float, stood_s: float, world_from_own: Matrix) -> Moved:
        return self

    def corrected(self, robot: str, own_from_sender: Matrix, shown: Estimate) -> Known:
        return Known(self.by, 0.0)

    def usual_m(self) -> None:
        return None


def test_a_frame_is_fused_with_poses_as_the_ego_had_put_them_right(tmp_path: Path) -> None:
    world = FactoryWorld(robots=3, rings=16)
    told = []
    for number in NUMBERS:
        own, sender = (world.pose(robot, number).matrix() for robot in ("R1", "R2"))
        by = correction(np.array([0.6, -0.3, 0.02]), (invert(own) @ sender)[:2, 3])
        move = move_of(own @ by @ invert(own), sender[:2, 3])
        fused = detections(world, number, Moved(by))
        told.append(msgspec.structs.replace(fused, corrections={"R2": move}))
    untold = [msgspec.structs.replace(one, corrections={}) for one in told]
    result = check(RecordingWorld(write_recording(tmp_path / "told.mcap", told)))
    assert (result.compared, result.equal, result.different) == (3, 3, ())
    assert result.largest < 1e-5
    assert check(RecordingWorld(write_recording(tmp_path / "untold.mcap", untold))).equal == 0


def test_foxglove_finds_its_own_schemas_and_json_with_schemas(recorded: Path) -> None:
    with recorded.open("rb") as file:
        summary = make_reader(file).get_summary()
        assert summary is not None
        assert summary.statistics is not None
        kinds = {
            channel.topic: (channel.message_encoding, summary.schemas[channel.schema_id])
            for channel in summary.channels.values()
        }
    named = {topic: (encoding, schema.name) for topic, (encoding, schema) in kinds.items()}
    assert named["/robot/R2/points"] == ("protobuf", "foxglove.PointCloud")
    assert named["/ego/boxes"] == named["/truth/boxes"] == ("protobuf", "foxglove.SceneUpdate")
    assert named["/tf"] == ("protobuf", "foxglove.FrameTransforms")
    assert named["/log"] == ("protobuf", "foxglove.Log")
    assert named["/ego/decision"] == ("json", "coadapt.Decision")
    for encoding, schema in kinds.values():
        if encoding == "json":
            assert b'"type": "object"' in schema.data or b'"type":"object"' in schema.data


def test_a_clock_that_is_set_back_loses_no_frame_and_adds_no_bytes(tmp_path: Path) -> None:
    file = RecordingFile(write_recording(tmp_path / "back.mcap", (40, 10, 11)))
    assert [one.frame for one in file.messages(FUSED, Fused)] == [10, 11, 40]
    first, second, late = file.messages(BUDGET, Budget)
    assert first.used_bps == 8 * first.bytes > 0
    assert second.used_bps == 8 * (first.bytes + second.bytes)
    assert late.used_bps == 8 * late.bytes


def test_detections_of_a_time_that_a_recording_cannot_name_are_left_out(tmp_path: Path) -> None:
    spec = make_spec(robots=("R1", "R2"), run_dir=str(tmp_path))
    outlet = Outlet(Sink(tmp_path / "far.mcap"))
    recorder = Recorder(spec, outlet, None, "none", EPOCH_NS)
    found = detections(FactoryWorld(robots=2, rings=16), 3)
    far = msgspec.structs.replace(found, frame=4, capture_ns=2**32 * 10**9)
    for message in (far, found):
        recorder.take(Received(message, EPOCH_NS))
    outlet.close()
    file = RecordingFile(tmp_path / "far.mcap")
    assert [one.frame for one in file.messages(FUSED, Fused)] == [3]
    assert file.count(LOG) == 2  # Why the first is not in it, and who is missing in the second.


def test_fused_objects_are_recorded_as_ros_2_messages_where_that_is_wanted(tmp_path: Path) -> None:
    spec = make_spec(robots=("R1", "R2"), run_dir=str(tmp_path))
    outlet = Outlet(Sink(tmp_path / "ros.mcap"))
    recorder = Recorder(spec, outlet, None, "none", EPOCH_NS, Teller("R1"))
    found = detections(FactoryWorld(robots=2, rings=16), 3)
    seen = next(one for one in SAMPLES if isinstance(one, SceneDescription))
    for message in (found, msgspec.structs.replace(seen, robot="R1")):
        recorder.take(Received(message, EPOCH_NS))
    outlet.close()
    read: dict[str, Any] = {}
    with (tmp_path / "ros.mcap").open("rb") as file:
        for schema, channel, raw in make_reader(file).iter_messages():
            if schema is None or schema.encoding != "ros2msg":
                continue
            assert channel.message_encoding == "cdr"
            store = get_typestore(Stores.EMPTY)
            store.register(get_types_from_msg(schema.data.decode(), schema.name))
            read[channel.topic] = store.deserialize_cdr(raw.data, schema.name)
    assert set(read) == {"/coadapt/objects", "/coadapt/markers", "/coadapt/unseen"}
    objects = read["/coadapt/objects"]
    assert len(objects.detections) == len(found.labels) + len(found.known) > 0
    assert RecordingFile(tmp_path / "ros.mcap").count(FUSED) == 1


def test_who_is_missing_is_logged_once_for_each_kind_of_reason(tmp_path: Path) -> None:
    spec = make_spec(robots=("R1", "R2", "R3"), run_dir=str(tmp_path))
    outlet = Outlet(Sink(tmp_path / "missing.mcap"))
    recorder = Recorder(spec, outlet, None, "none", EPOCH_NS)
    found = detections(FactoryWorld(robots=2, rings=16), 3)
    told = [("skew: 1.1 s off", "skew"), ("skew: 1.2 s off", "skew"), ("left: gone", "left")]
    for frame, (why, kind) in enumerate(told, 3):
        message = msgspec.structs.replace(
            found, frame=frame, missing={"R3": why}, missing_kinds={"R3": kind}
        )
        recorder.take(Received(message, EPOCH_NS))
    outlet.close()
    assert RecordingFile(tmp_path / "missing.mcap").count(LOG) == 2


def test_what_is_not_said_again_is_shown_for_three_seconds() -> None:
    box = Box(center=(1, 2, 3), size=(1, 1, 1), heading=0, label="box")
    found = shapes.boxes([box], EPOCH_NS, shapes.FUSED_COLOR, 0.4)
    of_its_entity = bytes([4 << 3 | 2, 2, 1 << 3, 3])  # Field 4, lifetime: field 1, seconds, is 3.
    assert of_its_entity in found.encode()


@pytest.mark.parametrize("port", [-1, 65536])
def test_a_port_that_there_is_not_is_named(port: int) -> None:
    with pytest.raises(RecordingError, match=rf"port {port} on 127.0.0.1, for Foxglove"):
        Outlet(None, port)


def test_a_recording_ends_when_its_folder_is_gone(tmp_path: Path) -> None:
    sink = Sink(tmp_path / "folder" / "gone.mcap")
    assert sink.nearly_full() is None
    sink.discard()
    sink.path.parent.rmdir()
    assert "its folder is gone" in (sink.nearly_full() or "")


def test_a_file_cut_off_is_used_up_to_the_cut(recorded: Path, tmp_path: Path) -> None:
    whole = RecordingWorld(recorded)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(recorded.read_bytes()[: recorded.stat().st_size * 3 // 5])
    world = RecordingWorld(cut)
    assert 1 <= world.frame_count < whole.frame_count
    assert "cut off" in world.notes[0]
    np.testing.assert_array_equal(world.scan("R3", 0).points, whole.scan("R3", 0).points)
    assert check(world).equal >= 1


def test_what_is_no_recording_is_named_with_what_is_missing(tmp_path: Path) -> None:
    path = tmp_path / "other.mcap"
    with pytest.raises(WorldError, match=r"recording .*other.mcap cannot be read"):
        RecordingWorld(path)
    path.write_bytes(b"something else")
    with pytest.raises(WorldError, match=r"other.mcap is not an MCAP file"):
        RecordingWorld(path)
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        channel = writer.register_channel("/chatter", "json", 0)
        writer.add_message(channel, log_time=1, publish_time=1, data=b"{}")
        writer.finish()
    with pytest.raises(WorldError, match=r"no recording of a swarm: it has no topic /recording"):
        RecordingFile(path)
    with pytest.raises(WorldError, match="needs the file"):
        open_world("recording")


def test_scans_are_recorded_of_nobody_of_participants_or_of_all(tmp_path: Path) -> None:
    chosen = RecordingWorld(write_recording(tmp_path / "selected.mcap", NUMBERS, points="selected"))
    # R3 was asked, though its answer did not come.
    assert all(len(chosen.scan(robot, 0).points) for robot in ("R1", "R2", "R3"))
    nothing = write_recording(tmp_path / "none.mcap", NUMBERS, points="none")
    assert RecordingFile(nothing).count("/ego/detections") == 3
    with pytest.raises(WorldError, match="recorded with --points none"):
        RecordingWorld(nothing)


def test_a_recording_never_replaces_a_file(recorded: Path, tmp_path: Path) -> None:
    before = recorded.read_bytes()
    with pytest.raises(RecordingError, match="is there already"):
        Sink(recorded)
    assert recorded.read_bytes() == before
    (tmp_path / "file").touch()
    with pytest.raises(RecordingError, match="cannot be written"):
        Sink(tmp_path / "file" / "x.mcap")


def test_replay_prints_what_is_in_a_file(
    recorded: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", str(recorded), "--check"]) == 0
    shown = capsys.readouterr().out
    assert "3 of 3 frames fuse to the recorded boxes" in shown
    assert "/robot/R1/points" in shown
    assert main(["replay", str(recorded.parent / "none")]) == 1
    assert "cannot be read" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (b"\x32\x03abc", "no float32 x, y, z"),
        (b"\x32\x09abc", "ends within a field"),
        (b"\x32", "malformed"),
    ],
)
def test_a_malformed_cloud_is_an_error(message: bytes, words: str) -> None:
    with pytest.raises(WorldError, match=words):
        read_points(message)
    assert read_points(b"").shape == (0, 3)


def test_a_frame_from_before_robots_were_told_apart_is_read_but_not_compared() -> None:
    raw = (
        b'{"ego":"R1","cycle":1,"frame":3,"capture_ns":5,"algorithm":"late","participants":["R1"],'
        b'"missing":{},"bytes":{},"latency_ms":4.0,"boxes":[{"center":[1,2,3],"size":[1,1,1],'
        b'"heading":0.5,"label":"robot","score":1.0}]}'
    )
    older = msgspec.json.decode(raw, type=Fused)
    assert older.known is None
    assert older.boxes[0].label == "robot"
    nothing: Any = None  # Neither world nor scan is looked at.
    assert "before known robots were told apart" in str(_apart(nothing, older, 0))
