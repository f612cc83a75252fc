"""What an ego remembers, in recordings: beside the boxes of single frames."""

from __future__ import annotations

import struct
from collections import defaultdict
from pathlib import Path

import msgspec
import numpy as np
import pytest
from mcap.reader import make_reader

from deploy.spec import make_spec
from options.recordings.check import check
from options.recordings.clouds import _fields
from options.recordings.file import RecordingFile
from options.recordings.format import FUSED, LOG, TRACKS, Fused, Track
from options.recordings.listen import Received
from options.recordings.outlet import Outlet
from options.recordings.recorder import Recorder
from options.recordings.sink import Sink
from options.recordings.world import RecordingWorld
from swarm.arrays import pack
from swarm.messages import Detections, Tracks
from tests.support.paths import GOLDEN
from tests.support.recording_files import EPOCH_NS, detections, write_recording
from worlds.factory.world import FactoryWorld

SEEN = Track(
    center=(1.0, 2.0, 0.5),
    size=(0.5, 0.5, 1.75),
    heading=0.25,
    label="person",
    score=0.75,
    id=7,
    velocity=(0.75, -1.0),
    age_s=0.0,
)
STILL = msgspec.structs.replace(
    SEEN, center=(5.0, 2.0, 1.0), label="forklift", id=12, velocity=(0.0, 0.0)
)
OF_BEFORE = msgspec.structs.replace(SEEN, age_s=0.5)


def told(number: int, *remembered: Track) -> Detections:
    """What an ego with memory says of a frame."""
    rows = [
        (*one.center, *one.size, one.heading, one.score, *one.velocity, one.age_s)
        for one in remembered
    ]
    table = np.array(rows, dtype=np.float32).reshape(-1, 11)
    return msgspec.structs.replace(
        detections(FactoryWorld(robots=3, rings=16), number),
        tracks=Tracks(
            ids=tuple(one.id for one in remembered),
            labels=tuple(one.label for one in remembered),
            boxes=pack(table[:, :7]),
            scores=pack(table[:, 7:8]),
            velocities=pack(table[:, 8:10]),
            ages_s=pack(table[:, 10:]),
        ),
    )


FRAMES = ((SEEN, STILL), (OF_BEFORE,), ())


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("remembered") / "run.mcap"
    return write_recording(path, [told(at, *frame) for at, frame in enumerate(FRAMES, 40)])


def parts(message: bytes | memoryview) -> dict[int, list[memoryview]]:
    """The fields of a protobuf message that are bytes, by number."""
    found: dict[int, list[memoryview]] = defaultdict(list)
    for number, value in _fields(memoryview(message)):
        if isinstance(value, memoryview):
            found[number].append(value)
    return found


def drawn(path: Path) -> list[tuple[dict[str, memoryview], list[str]]]:
    """Of each message: the entities by id, and the ids that are taken away."""
    with path.open("rb") as file:
        raw = [one.data for _, _, one in make_reader(file).iter_messages(topics=[TRACKS])]
    updates = [parts(one) for one in raw]
    return [
        (
            {str(parts(one)[3][0], "utf-8"): one for one in update[2]},
            [str(parts(one)[3][0], "utf-8") for one in update[1]],
        )
        for update in updates
    ]


def test_remembered_objects_are_read_as_they_were_told(recorded: Path) -> None:
    read = RecordingFile(recorded).messages(FUSED, Fused)
    assert [one.tracks for one in read] == list(FRAMES)


def test_a_recording_fuses_again_as_one_without_them(recorded: Path, tmp_path: Path) -> None:
    without = write_recording(tmp_path / "without.mcap", (40, 41, 42))
    file = RecordingFile(without)
    assert TRACKS not in file.topics
    assert [one.tracks for one in file.messages(FUSED, Fused)] == [None] * 3
    assert RecordingFile(recorded).topics[TRACKS] == "foxglove.SceneUpdate"
    result = check(RecordingWorld(recorded))
    assert result == check(RecordingWorld(without))
    assert result.equal == 3


def test_an_object_keeps_its_entity_until_it_is_forgotten(recorded: Path) -> None:
    assert [(set(entities), gone) for entities, gone in drawn(recorded)] == [
        ({"7", "12"}, []),
        ({"7"}, ["12"]),
        (set(), ["7"]),
    ]


def test_an_object_is_fainter_when_nobody_has_seen_it_in_this_frame(recorded: Path) -> None:
    def opacity(entity: memoryview) -> float:
        (cube,) = parts(entity)[8]
        (alpha,) = struct.unpack("<d", parts(cube)[3][0][-8:])
        return float(alpha)

    (first, _), (second, _), _ = drawn(recorded)
    assert opacity(first["7"]) == opacity(first["12"]) > opacity(second["7"]) > 0


def test_an_object_is_named_with_its_id_and_speed(recorded: Path) -> None:
    entities, _ = drawn(recorded)[0]
    texts = {name: str(parts(parts(one)[13][0])[6][0], "utf-8") for name, one in entities.items()}
    assert texts == {"7": "person 7 1.2 m/s", "12": "forklift 12 0.0 m/s"}


def test_detections_whose_memory_is_malformed_are_left_out(tmp_path: Path) -> None:
    good = told(40, SEEN)
    assert good.tracks is not None
    of_two = msgspec.structs.replace(good.tracks, ids=(7, 8))
    bad = msgspec.structs.replace(good, frame=41, tracks=of_two)
    outlet = Outlet(Sink(tmp_path / "bad.mcap"))
    spec = make_spec(robots=("R1", "R2", "R3"), run_dir=str(tmp_path))
    recorder = Recorder(spec, outlet, None, "none", EPOCH_NS)
    for message in (bad, good):
        recorder.take(Received(message, EPOCH_NS))
    outlet.close()
    file = RecordingFile(tmp_path / "bad.mcap")
    assert [one.frame for one in file.messages(FUSED, Fused)] == [40]
    assert file.count(LOG) == 2  # Why the first is not in it, and who is missing in the second.


@pytest.mark.parametrize("name", ["recording-1.mcap", "recording-2.mcap"])
def test_an_older_recording_has_none(name: str) -> None:
    fused = RecordingFile(GOLDEN / "older" / name).messages(FUSED, Fused)
    assert fused
    assert {one.tracks for one in fused} == {None}
