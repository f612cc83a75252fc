"""`coadapt record` on a real swarm: router, robots and ego are processes, over real Zenoh."""

from __future__ import annotations

import asyncio
import json
import threading
import time
from collections.abc import Callable, Iterator
from importlib import resources
from pathlib import Path

import aiohttp
import numpy as np
import pytest
from mcap.reader import make_reader

from coadapt.main import main
from deploy.spec import make_spec
from deploy.state import State
from options.recordings.check import check
from options.recordings.file import RecordingFile
from options.recordings.format import FUSED, LOG, Fused
from options.recordings.listen import Listener, Presence, Received
from options.recordings.record import Result, Wanted, record
from options.recordings.recorder import Recorder
from options.recordings.sink import Sink
from options.recordings.world import RecordingWorld
from swarm.errors import RecordingError, TransportError
from swarm.messages import Beacon, Decision, Detections, Message, SceneDescription
from tests.support.ego_swarm import Swarm, float32, in_float32, swarm_of
from tests.support.first_hour import Figure
from tests.support.recording_files import write_recording
from tests.support.zenoh_fixtures import RouterProcess
from worlds.factory.world import FactoryWorld

ROBOTS = ("R1", "R2")
Taken = list[Message | Presence]
"""What a recorder has been given."""


def everything(taken: Taken) -> bool:
    """Whether two frames and a decision of all are there, and all that R2 says."""
    both = [type(one) for one in taken if getattr(one, "participants", None) == ROBOTS]
    of_r2 = {type(one) for one in taken if getattr(one, "robot", None) == "R2"}
    return (
        both.count(Detections) >= 2
        and Decision in both
        and of_r2 >= {Presence, Beacon, SceneDescription}
    )


def frames_at_two_rates(taken: Taken) -> bool:
    """Whether there are frames that a rate of 1 Hz takes and such that it leaves out."""
    return {one.frame % 2 for one in taken if isinstance(one, Detections)} == {0, 1}


class Running:
    """A swarm of processes, and its record as `up` would have left it."""

    def __init__(
        self,
        swarm: Swarm,
        folder: Path,
        *,
        robots: tuple[str, ...] = ROBOTS,
        world: str = "recording",
        rings: int = 16,
    ) -> None:
        self.swarm = swarm
        self.robots = robots
        self.state = State(
            runtime="netns",
            spec=make_spec(
                swarm="test",
                robots=robots,
                world=world,
                rings=rings,
                data=swarm.env.get("COADAPT_WORLD_DATA", ""),
                epoch_ns=int(swarm.env["COADAPT_EPOCH_NS"]),
                run_dir=str(folder),
                var_dir=str(folder),
            ),
            router=swarm.address,
        )
        self.taken_down = threading.Event()
        self._frames = swarm.detections(swarm.session(), "R1")

    def fused_together(self) -> None:
        """Waits for a frame to which all have contributed."""
        self._frames.skip()
        self._frames.until(lambda frame: len(frame.participants) == len(self.robots))

    def record(self, wanted: Wanted, stop: threading.Event | None = None) -> Result:
        return record(
            self.state,
            wanted,
            stop or threading.Event(),
            lambda line: None,
            self.taken_down.is_set,
        )

    def record_until(self, wanted: Wanted, enough: Callable[[Taken], bool]) -> Result:
        """A recording that is stopped when what it has taken is enough."""
        stop, taken, take = threading.Event(), Taken(), Recorder.take

        def noted(recorder: Recorder, heard: Received, hurry: bool = False) -> None:
            take(recorder, heard, hurry)
            taken.append(heard.message)
            if enough(taken):
                stop.set()

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(Recorder, "take", noted)
            return self.record(wanted, stop)


@pytest.fixture(autouse=True, scope="module")
def exact() -> Iterator[None]:
    """What two processes find is compared to the last digit."""
    with in_float32():
        yield


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """An ego and another robot that fuse boxes, in a world of two frames a second: there a robot
    whose newest scan is the one before refuses to send it, however busy the machine is."""
    folder = tmp_path_factory.mktemp("swarm")
    source = write_recording(folder / "source.mcap", range(0, 60, 5), robots=2)
    world = {"COADAPT_WORLD": "recording", "COADAPT_WORLD_DATA": str(source)}
    with swarm_of(world | float32(), folder) as swarm:
        swarm.router()
        swarm.robot("R2")
        journal = str(folder / "journal.jsonl")
        swarm.ego(ego="R1", policy="static-late", deadline_s="0.45", journal=journal)
        running = Running(swarm, folder)
        running.fused_together()
        yield running


@pytest.fixture(scope="module")
def made(running: Running) -> Result:
    """A recording that is stopped when everybody has told of everything."""
    wanted = Wanted(Path(running.state.spec.var_dir) / "made.mcap", seconds=60.0)
    return running.record_until(wanted, everything)


def test_a_recording_of_one_run_replays_to_the_same_detections(
    running: Running, made: Result
) -> None:
    assert made.path is not None
    world = RecordingWorld(made.path)
    fused = world.file.messages(FUSED, Fused)
    together = [one for one in fused if one.participants == ROBOTS]
    assert together
    result = check(world)
    assert result.compared == made.frames == made.fused == len(fused)
    assert result.boxes > 0
    assert result.different == ()
    assert result.equal == result.compared
    assert result.largest < 1e-4
    ran = RecordingWorld(Path(running.state.spec.data))
    for one in fused:
        frame = world.frame_of(one.frame)
        assert frame is not None
        scan, expected = world.scan("R2", frame), ran.scan("R2", one.frame)
        np.testing.assert_array_equal(scan.points, expected.points)
        assert scan.pose == expected.pose


FLOOR = ("R1", "R2", "R3", "R4")
FLOOR_FRAMES = 25
"""Enough that what is written once does not count."""


@pytest.mark.stumble(
    "a recording of 4 robots takes 73 MB for 8 s",
    command="make record ARGS='--seconds 8'; coadapt replay run.mcap --check",
)
def test_a_recording_of_a_factory_is_small_and_exact(tmp_path: Path, figure: Figure) -> None:
    """Four robots with 32 rings. However many frames a busy machine fuses, the figure is that of
    all frames of the world's rate."""
    world = {"COADAPT_WORLD": "factory", "COADAPT_WORLD_ROBOTS": str(len(FLOOR))}
    with swarm_of(world | float32(), tmp_path) as swarm:
        swarm.router()
        swarm.robot(*FLOOR[1:])
        swarm.ego(
            ego="R1",
            policy="static-late",
            rarer="false",  # all of them in one frame
            journal=str(tmp_path / "journal.jsonl"),
        )
        running = Running(swarm, tmp_path, robots=FLOOR, world="factory", rings=32)
        running.fused_together()
        wanted = Wanted(tmp_path / "floor.mcap", seconds=90.0)
        made = running.record_until(
            wanted, lambda taken: sum(type(one) is Detections for one in taken) >= FLOOR_FRAMES
        )
    assert made.path is not None
    assert made.left_out == made.lost == 0
    recorded = RecordingWorld(made.path)
    assert recorded.rate_hz <= 10.0
    floor = FactoryWorld(robots=len(FLOOR))
    fused = recorded.file.messages(FUSED, Fused)
    for one in fused[::8]:
        frame = recorded.frame_of(one.frame)
        assert frame is not None
        for robot in FLOOR:
            scan, expected = recorded.scan(robot, frame), floor.scan(robot, one.frame)
            assert scan.points.tobytes() == expected.points.tobytes()
    result = check(recorded)
    # A robot of a busy machine may answer with the scan before the one asked for.
    assert result.compared + result.other_times + result.about_places == made.frames
    assert result.equal == result.compared > 0, result.different
    assert result.largest < 1e-4
    per_scan_mb = made.bytes / 1e6 / made.frames / len(FLOOR)
    mb_per_robot_s = per_scan_mb * floor.rate_hz
    figure("recording_mb_per_robot_s", round(mb_per_robot_s, 3))
    assert mb_per_robot_s <= 0.5


def test_the_file_is_whole_and_holds_what_the_swarm_said(made: Result) -> None:
    assert made.path is not None
    assert made.ended == "stopped"
    assert made.bytes == made.path.stat().st_size
    file = RecordingFile(made.path)
    assert not file.notes
    topics = {"/ego/decision", "/ego/budget", "/robot/R2/beacon", "/robot/R2/objects", LOG}
    assert topics <= file.topics.keys()
    with made.path.open("rb") as whole:
        texts = [message.data for _, _, message in make_reader(whole).iter_messages(LOG)]
    assert any(b"late from R1, R2" in text for text in texts)
    assert any(b"R2 joined" in text for text in texts)


def test_a_swarm_that_is_taken_down_ends_the_recording_whole(
    running: Running, tmp_path: Path
) -> None:
    running.taken_down.set()
    try:
        result = running.record(Wanted(tmp_path / "gone.mcap", points="none"))
    finally:
        running.taken_down.clear()
    assert result.ended == "the swarm was taken down"
    assert not RecordingFile(tmp_path / "gone.mcap").notes


def test_stopping_ends_the_recording_whole(running: Running, tmp_path: Path) -> None:
    stop = threading.Event()
    stop.set()
    result = running.record(Wanted(tmp_path / "stopped.mcap"), stop)
    assert result.ended == "stopped"
    assert RecordingFile(tmp_path / "stopped.mcap").header.robots == ROBOTS


def test_a_recording_ends_although_more_comes_than_can_be_written(
    running: Running, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def another(listener: Listener, timeout_s: float) -> Received:
        return Received(Presence("R9", alive=True), time.time_ns())

    monkeypatch.setattr(Listener, "next", another)
    monkeypatch.setattr(Listener, "waiting", lambda listener: 3)
    made = running.record(Wanted(tmp_path / "flood.mcap", points="none", seconds=0.3))
    assert made.ended == "0.3 s are over"


def test_a_rate_and_no_truth_make_a_recording_smaller(running: Running, tmp_path: Path) -> None:
    path = tmp_path / "small.mcap"
    wanted = Wanted(path, truth=False, rate_hz=1.0, seconds=60.0)
    result = running.record_until(wanted, frames_at_two_rates)
    assert 1 <= result.frames < result.fused
    assert result.left_out == 0
    world = RecordingWorld(path)
    assert not len(world.ground_truth(0).boxes)
    assert len(world.scan("R2", 0).points)


def test_foxglove_sees_the_swarm_live(running: Running) -> None:
    stop, where = threading.Event(), threading.Event()
    said: list[str] = []

    def say(line: str) -> None:
        said.append(line)
        where.set()

    wanted = Wanted(None, points="none", live_port=0)
    thread = threading.Thread(
        target=lambda: record(running.state, wanted, stop, say, lambda: False)
    )
    thread.start()
    try:
        assert where.wait(20)
        url = said[0].rsplit(" ", 1)[1]
        topics = asyncio.run(asyncio.wait_for(advertised(url, "/ego/detections"), 20))
    finally:
        stop.set()
        thread.join(20)
    assert topics["/ego/detections"] == "json"


async def advertised(url: str, wanted: str) -> dict[str, str]:
    """The encodings by topic that a Foxglove WebSocket server offers, once it offers one."""
    found: dict[str, str] = {}
    async with (
        aiohttp.ClientSession() as client,
        client.ws_connect(url, protocols=("foxglove.sdk.v1",)) as socket,
    ):
        while wanted not in found:
            message = await socket.receive()
            if message.type is aiohttp.WSMsgType.TEXT:
                said = json.loads(message.data)
                found |= {one["topic"]: one["encoding"] for one in said.get("channels", ())}
    return found


def test_nothing_begins_where_it_could_not_end_well(
    running: Running, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("options.recordings.record.CONNECT_S", 0.5)
    there = tmp_path / "there.mcap"
    there.write_text("mine")
    with pytest.raises(RecordingError, match=r"there.mcap is there already"):
        running.record(Wanted(there))
    assert there.read_text() == "mine"
    with pytest.raises(RecordingError, match="rate 0 cannot be used"):
        running.record(Wanted(tmp_path / "a.mcap", rate_hz=0))
    with pytest.raises(RecordingError, match=r"port \d+ on 127.0.0.1, for Foxglove"):
        running.record(Wanted(tmp_path / "b.mcap", live_port=running.swarm.port))
    state = State(runtime="netns", spec=running.state.spec, router="tcp/127.0.0.1:1")
    with pytest.raises(TransportError):
        record(state, Wanted(tmp_path / "c.mcap"), threading.Event(), print, lambda: False)
    assert [path.name for path in tmp_path.iterdir()] == ["there.mcap"]


def test_a_router_that_stays_away_ends_the_recording_whole(
    own_router: RouterProcess, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("options.recordings.record.AWAY_S", 0.5)
    spec = make_spec(swarm="test", robots=ROBOTS, rings=16, run_dir=str(tmp_path))
    state = State(runtime="netns", spec=spec, router=own_router.address)
    killed = threading.Event()

    def gone() -> bool:
        # Asked while it records: by then it is connected.
        if not killed.is_set():
            own_router.stop(kill=True)
            killed.set()
        return False

    path = tmp_path / "away.mcap"
    result = record(state, Wanted(path, points="none"), threading.Event(), print, gone)
    assert "router has been away" in result.ended
    assert not RecordingFile(path).notes


def test_a_disk_that_is_full_ends_the_recording_and_is_said(
    running: Running, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(sink: Sink, data: bytes) -> int:
        sink.error = "No space left on device"
        raise OSError(28, sink.error)

    monkeypatch.setattr(Sink, "write", full)
    with pytest.raises(RecordingError, match="written to its end: No space left"):
        running.record(Wanted(tmp_path / "full.mcap"))


def test_without_a_swarm_nothing_is_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COADAPT_RUN_DIR", str(tmp_path / "run"))
    assert main(["record", str(tmp_path / "x.mcap")]) == 1
    assert "no swarm 'local' is running" in capsys.readouterr().err
    assert not (tmp_path / "x.mcap").exists()


def test_the_layout_shows_topics_of_recordings(
    made: Result, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["record", "--layout"]) == 0
    layout = json.loads(capsys.readouterr().out)
    packed = resources.files("options.recordings").joinpath("foxglove-layout.json").read_text()
    assert layout == json.loads(packed)
    panels = layout["configById"]
    assert made.path is not None
    topics = RecordingFile(made.path).topics.keys()
    own = {topic for topic in panels["3D!swarm"]["topics"] if "/R2/" in topic}
    assert own <= topics
    assert panels["RawMessages!decision"]["topicPath"] in topics
    assert panels["RosOut!log"]["topicToRender"] in topics
    for path in panels["Plot!budget"]["paths"]:
        assert path["value"].split(".")[0] in topics
