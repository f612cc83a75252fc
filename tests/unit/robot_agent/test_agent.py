"""One robot without a network: what it senses, tells and answers."""

from __future__ import annotations

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from perception.codec.boxes import BYTES_PER_BOX, decode_boxes
from perception.codec.outlined import take_outline
from perception.codec.places import encode_places
from perception.codec.points import decode_points
from perception.fusion.algorithms.late import SENT_BOXES
from perception.fusion.base import EncodeOptions
from perception.fusion.registry import fusion_names
from perception.scene import from_array
from perception.types import Boxes
from robot_agent.encoder import Encoder
from robot_agent.frames import Encoded
from swarm.arrays import unpack_finite
from swarm.errors import PerceptionError, WorldError
from swarm.geometry import Points, transform
from swarm.messages import ObservationRequest, SceneDescription, decode, encode
from swarm.process import Clock, capture_ns
from tests.support.robot_worlds import BLOCKS, ChosenWorld, Robot, room
from worlds.factory.world import FactoryWorld


def request(**changes: object) -> ObservationRequest:
    values: dict[str, object] = {"ego": "E", "request": 1, "algorithm": "early", "capture_ns": 0}
    return ObservationRequest(**{**values, **changes})  # type: ignore[arg-type]


def test_waiting_for_a_processor_is_no_work() -> None:
    robot = sensed()
    fusion = robot.agent._encoder._fusions["early"]
    encode_once = fusion.encode

    def slowly(points: Points, options: EncodeOptions) -> bytes:
        time.sleep(0.5)
        return encode_once(points, options)

    fusion.encode = slowly  # type: ignore[method-assign]
    told = robot.agent.observe(request())
    assert 0.0 < told.work_ms <= told.encode_ms - 450.0


def test_who_asks_for_an_encoded_frame_hears_what_it_took_too() -> None:
    robot = sensed()
    first, second = (robot.agent.observe(request(request=number)) for number in (1, 2))
    assert first.payload is second.payload
    assert first.work_ms == second.work_ms > 0.0


def sensed(points: object = room, **options: object) -> Robot:
    robot = Robot(ChosenWorld(points), **options)  # type: ignore[arg-type]
    robot.sense()
    return robot


def test_a_beacon_tells_the_newest_frame_on_the_robots_clock() -> None:
    robot = sensed()
    beacon = robot.agent.beacon()
    assert beacon is not None
    assert beacon.robot == "R1"
    assert beacon.capture_ns == capture_ns(robot.epoch_ns, 10.0, beacon.frame)
    assert beacon.capture_ns <= beacon.sent_ns
    assert beacon.pose == ChosenWorld().pose("R1", 0).as_tuple()
    assert (beacon.velocity, beacon.range_m) == ((1.0, 0.0, 0.0), 20.0)
    assert beacon.sizes == {}
    again = robot.agent.beacon()
    assert again is not None
    assert again.seq == beacon.seq + 1


def test_a_beacon_tells_the_bytes_that_an_observation_then_has_and_most_of_late() -> None:
    robot = sensed()
    robot.measure_all()
    beacon = robot.agent.beacon()
    assert beacon is not None
    assert set(beacon.sizes) == set(fusion_names("factory"))
    for algorithm, size in beacon.sizes.items():
        sent = len(robot.agent.observe(request(algorithm=algorithm)).payload)
        assert sent <= size if algorithm == "late" else sent == size
        told = robot.agent.beacon()
        assert told is not None
        assert told.sizes[algorithm] == sent
        assert robot.value("coadapt_robot_payload_bytes", robot="R1", algorithm=algorithm) == sent


def test_late_is_bounded_by_its_boxes_without_a_run_of_the_detector() -> None:
    robot = sensed()
    robot.measure_all()
    beacon = robot.agent.beacon()
    assert beacon is not None
    assert robot.value("coadapt_robot_encode_seconds_count", algorithm="late") == 0
    boxes, _ = take_outline(robot.agent.observe(request(algorithm="late")).payload)
    slack = (SENT_BOXES - len(decode_boxes(boxes))) * BYTES_PER_BOX
    sent = len(robot.agent.observe(request(algorithm="late")).payload)
    assert sent + slack <= beacon.sizes["late"] <= sent + slack + 40


def test_a_measurement_encodes_for_one_algorithm_and_none_that_answers_have_told() -> None:
    robot = sensed()
    robot.agent.observe(request())
    encoded = [robot.encoded()]
    for _ in range(len(fusion_names("factory")) + 2):
        robot.agent.measure()
        encoded.append(robot.encoded())
    steps = [after - before for before, after in pairwise(encoded)]
    others = len(fusion_names("factory")) - len(["early", "late"])
    assert steps == [1] * others + [0] * (len(steps) - others)
    assert robot.value("coadapt_robot_encode_seconds_count", algorithm="early") == 1


def test_a_size_that_is_too_old_is_measured_anew() -> None:
    robot = sensed(size_period_s=1e-6)
    robot.measure_all()
    before = robot.encoded()
    robot.sense()
    robot.agent.measure()
    assert robot.encoded() == before + 1


def test_nothing_is_measured_while_an_answer_is_encoded(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = sensed()
    begun, go = threading.Event(), threading.Event()
    encode = Encoder.encode

    def held(self: Encoder, *form: Any) -> Encoded:
        begun.set()
        assert go.wait(60)
        return encode(self, *form)

    monkeypatch.setattr(Encoder, "encode", held)
    with ThreadPoolExecutor(1) as pool:
        answer = pool.submit(robot.agent.observe, request())
        assert begun.wait(60)
        robot.agent.measure()  # would wait for `go`, too
        go.set()
        answer.result()
    assert robot.encoded() == 1


def test_sizes_are_measured_in_the_form_that_was_last_asked_for() -> None:
    robot = sensed(size_period_s=1e-6)
    robot.measure_all()
    coarse = robot.agent.beacon()
    fine = robot.agent.observe(request(max_error_m=0.005, keep_ground=True))
    robot.sense()
    for _ in fusion_names("factory"):
        robot.agent.measure()
    again = robot.agent.observe(request(max_error_m=0.005, keep_ground=True))
    assert robot.value("coadapt_robot_encode_seconds_count", algorithm="early") == 3
    beacon = robot.agent.beacon()
    assert coarse is not None
    assert beacon is not None
    assert beacon.sizes["early"] == len(again.payload)
    assert min(len(fine.payload), len(again.payload)) > coarse.sizes["early"]


def test_an_answer_about_places_is_no_size_of_a_whole_one() -> None:
    robot = sensed(size_period_s=1e-6)
    robot.measure_all()
    before = robot.agent.beacon()
    place = encode_places(one_box(), 1.0)
    about = robot.agent.observe(request(reference=(0.0,) * 6, demand=place))
    after = robot.agent.beacon()
    assert before is not None
    assert after is not None
    assert len(about.payload) < before.sizes["early"]
    assert after.sizes == before.sizes


def test_what_is_no_list_of_places_is_refused_with_what_is_allowed() -> None:
    with pytest.raises(PerceptionError, match="5 bytes are no places; allowed: up to 128 of 7"):
        sensed().agent.observe(request(reference=(0.0,) * 6, demand=b"12345"))
    with pytest.raises(PerceptionError, match="without where the ego is"):
        sensed().agent.observe(request(demand=bytes(7)))


def one_box() -> Boxes:
    return Boxes(np.zeros((1, 3)), np.ones((1, 3)), np.zeros(1), np.ones(1), ("person",))


def test_a_clock_that_is_off_shifts_all_times_of_the_robot_but_not_its_frames() -> None:
    robot = sensed(clock=Clock(100.0))
    beacon = robot.agent.beacon()
    assert beacon is not None
    assert beacon.capture_ns == capture_ns(robot.epoch_ns, 10.0, beacon.frame) + 100_000_000_000
    assert beacon.sent_ns >= beacon.capture_ns
    assert robot.agent.observe(request(capture_ns=beacon.capture_ns)).frame == beacon.frame
    with pytest.raises(PerceptionError, match="later"):
        robot.agent.observe(request(capture_ns=beacon.capture_ns - 100_000_000_000))


def test_a_robot_whose_clock_is_put_back_waits_for_one_frame_at_most(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    robot = sensed()
    now_ns = time.time_ns()
    monkeypatch.setattr("robot_agent.sensor.time.time_ns", lambda: now_ns - 86_400 * 10**9)
    assert 0.0 < robot.agent.sensor.next_frame_in_s() <= 0.1
    monkeypatch.setattr("robot_agent.sensor.time.time_ns", lambda: now_ns + 86_400 * 10**9)
    assert robot.agent.sensor.next_frame_in_s() == 0.0


def test_before_the_first_frame_there_is_no_beacon_no_scene_and_a_clear_refusal() -> None:
    robot = Robot(ChosenWorld())
    assert robot.agent.beacon() is None
    assert robot.agent.describe() is None
    robot.agent.measure()
    with pytest.raises(PerceptionError, match="R1 has no frame yet"):
        robot.agent.observe(request())


def test_a_scene_describes_the_objects_in_the_world_frame() -> None:
    robot = sensed()
    message = robot.agent.describe()
    assert message is not None
    scene = decode(encode(message), SceneDescription)
    objects = from_array(unpack_finite(scene.objects, "objects", 9)).objects
    world_from_sensor = scene.sensor_pose().matrix()
    middles = transform(world_from_sensor, np.add(BLOCKS, (0.45, 0.3, 0.6)))
    assert len(objects) == len(BLOCKS)
    for middle in middles:
        nearest = min(np.linalg.norm(np.subtract(o.centroid, middle)) for o in objects)
        assert nearest < 0.2
    visible = unpack_finite(scene.visible_m, "visible_m", 1)
    assert visible.shape == (72, 1)
    assert (visible >= 0).all()
    assert scene.ground_points > 3000


def test_a_frame_is_described_once() -> None:
    robot = sensed()
    assert robot.agent.describe() is not None
    assert robot.agent.describe() is None


@pytest.mark.parametrize("max_error_m", [0.1, 0.01])
def test_early_points_keep_the_bound_that_was_asked_for(max_error_m: float) -> None:
    robot = sensed()
    observation = robot.agent.observe(request(max_error_m=max_error_m, keep_ground=True))
    decoded = decode_points(take_outline(observation.payload)[0])
    scan = room(observation.frame)
    assert decoded.shape == scan.shape
    assert _farthest(scan, decoded) <= max_error_m
    assert _farthest(decoded, scan) <= max_error_m


def _farthest(points: Points, others: Points) -> float:
    """The largest distance from a point to its nearest other, metres."""
    from scipy.spatial import cKDTree

    return float(cKDTree(others).query(points)[0].max())


def test_late_boxes_lie_where_the_objects_are() -> None:
    factory = FactoryWorld(robots=4, seed=1_000_003)
    scan, actors = factory.scan_with_actors("R3", 40)
    robot = sensed(lambda frame: scan.points)
    boxes = decode_boxes(take_outline(robot.agent.observe(request(algorithm="late")).payload)[0])
    sure = boxes.take(boxes.scores > 0.6).transformed(scan.pose.matrix())
    truth, _ = factory.actors(40)
    well_seen = np.bincount(actors[actors >= 0], minlength=len(truth)) >= 100
    assert len(sure) >= well_seen.sum() > 0
    apart = np.linalg.norm(sure.centers[:, None, :2] - truth.centers[None, :, :2], axis=2)
    assert (apart.min(axis=1) < 0.3).all()
    assert (apart[:, well_seen].min(axis=0) < 0.3).all()


def test_points_without_a_return_are_left_out() -> None:
    def holes(frame: int) -> Points:
        points = room(frame)
        points[::3] = np.nan
        points[1] = np.inf
        return points

    robot = sensed(holes)
    robot.measure_all()
    assert robot.agent.describe() is not None
    observation = robot.agent.observe(request(keep_ground=True))
    decoded = decode_points(take_outline(observation.payload)[0])
    whole = holes(observation.frame)
    assert len(decoded) == np.isfinite(whole).all(axis=1).sum()
    assert np.isfinite(decoded).all()


@pytest.mark.parametrize("value", [None, np.nan], ids=["empty", "all NaN"])
def test_a_cloud_without_any_return_is_served_as_empty(value: float | None) -> None:
    cloud = np.full((0 if value is None else 50, 3), value or 0.0, dtype=np.float32)
    robot = sensed(lambda frame: cloud)
    robot.measure_all()
    scene = robot.agent.describe()
    assert scene is not None
    assert scene.objects.shape == (0, 9)
    assert scene.ground_points == 0
    payload, places = take_outline(robot.agent.observe(request()).payload)
    assert len(decode_points(payload)) == len(places) == 0
    boxes = decode_boxes(take_outline(robot.agent.observe(request(algorithm="late")).payload)[0])
    assert len(boxes) == len(Boxes.empty())
    beacon = robot.agent.beacon()
    assert beacon is not None
    assert set(beacon.sizes) == set(fusion_names("factory"))


@pytest.mark.parametrize(
    "cloud",
    [np.zeros((5, 4)), np.zeros(5)],
    ids=["four columns", "one dimension"],
)
def test_a_scan_that_is_no_cloud_counts_as_unreadable(cloud: Points) -> None:
    robot = sensed(lambda frame: cloud)
    assert robot.value("coadapt_robot_scans_unreadable_total", robot="R1") == 1
    assert robot.agent.beacon() is None


def test_an_unreadable_frame_is_counted_and_the_last_one_is_kept() -> None:
    broken = threading.Event()

    def sometimes(frame: int) -> Points:
        if broken.is_set():
            raise WorldError("disk gone")
        return room(frame)

    robot = sensed(sometimes)
    good = robot.agent.beacon()
    broken.set()
    robot.sense(2)
    beacon = robot.agent.beacon()
    assert good is not None
    assert beacon is not None
    assert beacon.frame == good.frame
    assert robot.value("coadapt_robot_scans_unreadable_total", robot="R1") == 2
    assert robot.agent.observe(request()).frame == good.frame
    broken.clear()
    robot.sense()
    later = robot.agent.beacon()
    assert later is not None
    assert later.frame > good.frame


def test_a_late_robot_takes_the_newest_frame_and_counts_those_left_out() -> None:
    robot = sensed()
    first = robot.agent.beacon()
    threading.Event().wait(0.35)
    robot.sense()
    second = robot.agent.beacon()
    assert first is not None
    assert second is not None
    skipped = robot.value("coadapt_robot_frames_skipped_total", robot="R1")
    assert skipped == second.frame - first.frame - 1 >= 2
    assert robot.value("coadapt_robot_scans_total", robot="R1") == 2


def test_the_frame_nearest_to_the_time_asked_for_is_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    # However many frames a busy machine leaves out.
    monkeypatch.setattr("robot_agent.agent.MAX_GAP_S", 60.0)
    robot = Robot(ChosenWorld(), ring_frames=3)
    frames = []
    for _ in range(4):
        robot.sense()
        beacon = robot.agent.beacon()
        assert beacon is not None
        frames.append(beacon)
    for beacon in frames[1:]:
        for shift_ns in (-40_000_000, 0, 40_000_000):
            asked = request(capture_ns=beacon.capture_ns + shift_ns)
            assert robot.agent.observe(asked).frame == beacon.frame
    # The first frame has left the ring of three: the nearest one is the second.
    assert robot.agent.observe(request(capture_ns=frames[0].capture_ns)).frame == frames[1].frame


@pytest.mark.parametrize(("shift_s", "word"), [(-0.3, "later"), (0.3, "earlier")])
def test_a_time_without_a_frame_near_it_is_refused(shift_s: float, word: str) -> None:
    robot = sensed()
    beacon = robot.agent.beacon()
    assert beacon is not None
    asked = request(capture_ns=beacon.capture_ns + round(shift_s * 1e9))
    with pytest.raises(PerceptionError, match=rf"0\.300 s {word}; allowed: 0\.25 s"):
        robot.agent.observe(asked)
    labels = {"robot": "R1", "algorithm": "early", "outcome": "too_old"}
    assert robot.value("coadapt_robot_requests_total", **labels) == 1


def test_a_payload_larger_than_asked_for_is_refused_and_not_counted_as_sent() -> None:
    robot = sensed()
    size = len(robot.agent.observe(request()).payload)
    with pytest.raises(PerceptionError, match=f"has {size} bytes, at most {size - 1}"):
        robot.agent.observe(request(max_bytes=size - 1))
    assert len(robot.agent.observe(request(max_bytes=size)).payload) == size
    sent = robot.value("coadapt_robot_observation_bytes_total", robot="R1", algorithm="early")
    assert sent == 2 * size


def test_an_algorithm_that_does_not_exist_is_refused_with_the_reason() -> None:
    robot = sensed()
    with pytest.raises(PerceptionError, match=r"'magic' is not available; allowed: early, interm"):
        robot.agent.observe(request(algorithm="magic"))
    labels = {"robot": "R1", "algorithm": "magic", "outcome": "failed"}
    assert robot.value("coadapt_robot_requests_total", **labels) == 1


def test_a_frame_is_encoded_once_for_the_measurement_and_all_egos() -> None:
    robot = sensed()
    robot.measure_all()
    with ThreadPoolExecutor(4) as pool:
        asked = [pool.submit(robot.agent.observe, request(ego=f"E{i}")) for i in range(8)]
    payloads = {future.result().payload for future in asked}
    assert len(payloads) == 1
    assert robot.value("coadapt_robot_encode_seconds_count", algorithm="early") == 1
