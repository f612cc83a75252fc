"""Messages: their bytes are plain MessagePack, and nothing invalid passes the boundary."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import msgpack
import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm import messages
from swarm.errors import MessageError
from swarm.geometry import Pose
from swarm.messages import (
    MAX_MESSAGE_BYTES,
    SCHEMA_VERSION,
    Beacon,
    Decision,
    Message,
    Observation,
    ObservationRequest,
    decode,
    encode,
)
from tests.support.message_samples import SAMPLES, golden_path
from tests.support.paths import GOLDEN, REPOSITORY

every_sample = pytest.mark.parametrize("sample", SAMPLES, ids=lambda m: type(m).__name__)
robot_ids = st.from_regex(r"[A-Za-z0-9_-]{1,32}", fullmatch=True)
counts = st.integers(0, 2**64 - 1)
times = st.integers(0, 2**62 - 1)
finite = st.floats(allow_nan=False, allow_infinity=False)
bounded = st.floats(-1e7, 1e7)
positive = st.floats(min_value=1e-9, allow_nan=False, allow_infinity=False)


def plain(message: Message) -> dict[str, Any]:
    """The message as another language's MessagePack library reads it."""
    return msgpack.unpackb(encode(message))


def broken(message: Message, **changes: Any) -> bytes:
    return msgpack.packb({**plain(message), **changes})


def sample_of(kind: type[Message]) -> Message:
    return next(sample for sample in SAMPLES if type(sample) is kind)


def test_every_message_type_has_a_golden_file() -> None:
    kinds = {kind for kind in vars(messages).values() if isinstance(kind, type)}
    declared = {kind for kind in kinds if issubclass(kind, Message) and kind is not Message}
    assert declared == {type(sample) for sample in SAMPLES}


@every_sample
def test_golden_bytes_are_what_this_version_writes_and_reads(sample: Message) -> None:
    golden = golden_path(sample).read_bytes()
    assert encode(sample) == golden
    assert decode(golden, type(sample)) == sample


def test_a_decision_of_a_program_that_learnt_nothing_is_still_read() -> None:
    before = (golden_path(sample_of(messages.Decision)).parent / "decision-1.msgpack").read_bytes()
    decision = decode(before, messages.Decision)
    assert decision.participants == ("R2", "R1")
    assert (decision.deadline_s, decision.held_s, decision.probe) == (None, None, None)
    assert decision.arrival == {}


def test_messages_of_older_programs_are_read_and_what_they_lack_has_its_default() -> None:
    kinds = {type(sample).__name__.lower(): type(sample) for sample in SAMPLES}
    older = sorted((GOLDEN / "older").glob("*.msgpack"))
    assert older
    for path in older:
        data = path.read_bytes()
        message = decode(data, kinds[path.stem.split("-")[0]])
        fields = msgpack.unpackb(data)
        for field in msgspec.structs.fields(type(message)):
            if field.name not in fields:
                assert not getattr(message, field.name)


@every_sample
def test_plain_msgpack_reads_and_writes_the_same_bytes(sample: Message) -> None:
    golden = golden_path(sample).read_bytes()
    fields = msgpack.unpackb(golden)
    assert fields["v"] == SCHEMA_VERSION
    assert set(fields) == set(sample.__struct_fields__)
    assert msgpack.packb(fields) == golden


def test_a_state_and_an_observation_from_before_queues_were_told_are_read() -> None:
    state = plain(sample_of(messages.NetState))
    for link in state["links"]:
        for traffic in link["classes"].values():
            del traffic["backlog"]
    read = decode(msgpack.packb(state), messages.NetState)
    assert read.links[0].classes["fusion"].backlog == messages.Backlog()
    seen = plain(sample_of(Observation))
    del seen["uplink"], seen["work_ms"]
    old = decode(msgpack.packb(seen), Observation)
    assert (old.uplink, old.work_ms) == (messages.Backlog(), 0.0)


def test_an_array_travels_as_dtype_shape_and_bytes() -> None:
    fields = plain(sample_of(messages.SceneDescription))
    assert fields["objects"]["dtype"] == "<f4"
    assert fields["objects"]["shape"] == [2, 9]
    assert len(fields["objects"]["bytes"]) == 2 * 9 * 4


def test_the_pose_of_a_message_is_a_pose() -> None:
    beacon = sample_of(Beacon)
    assert isinstance(beacon, Beacon)
    assert beacon.sensor_pose() == Pose(*beacon.pose)


@every_sample
def test_a_field_that_a_later_version_adds_is_ignored(sample: Message) -> None:
    assert decode(broken(sample, battery=0.5), type(sample)) == sample


def test_detections_of_a_version_that_did_not_tell_their_age_are_read() -> None:
    fields = plain(sample_of(messages.Detections))
    del fields["age_ms"]
    older = decode(msgpack.packb(fields), messages.Detections)
    assert older.age_ms is None


@every_sample
@pytest.mark.parametrize("version", [0, 2, "1", None, 1.5])
def test_another_schema_version_is_refused(sample: Message, version: object) -> None:
    with pytest.raises(MessageError, match=type(sample).__name__):
        decode(broken(sample, v=version), type(sample))


@every_sample
def test_a_truncated_message_is_refused(sample: Message) -> None:
    data = encode(sample)
    for end in range(0, len(data), max(1, len(data) // 50)):
        with pytest.raises(MessageError):
            decode(data[:end], type(sample))


@every_sample
def test_bytes_after_the_end_are_refused(sample: Message) -> None:
    with pytest.raises(MessageError):
        decode(encode(sample) + b"\xc0", type(sample))


@every_sample
def test_every_missing_required_field_is_refused(sample: Message) -> None:
    fields = plain(sample)
    optional = {f.name for f in msgspec.structs.fields(type(sample)) if not f.required}
    for name in set(fields) - optional:
        data = msgpack.packb({key: value for key, value in fields.items() if key != name})
        with pytest.raises(MessageError, match=name):
            decode(data, type(sample))


@every_sample
@pytest.mark.parametrize("wrong", [None, [[]], {"x": {}}, b"\x00"], ids=str)
def test_a_field_of_a_wrong_type_is_refused(sample: Message, wrong: object) -> None:
    for name in plain(sample):
        if name == "payload" and isinstance(wrong, bytes):
            continue
        if name in ("rate_bps", "duration_s", "revision") and wrong is None:
            continue  # An operator may leave them out.
        if name == "advice" and wrong is None:
            continue  # Most policies ask nobody.
        if name in ("intent", "effect") and wrong is None:
            continue  # Few requests are about one.
        if name == "body" and wrong is None:
            continue  # Robots of an earlier version do not tell it.
        optional = (
            *("age_ms", "deadline_s", "held_s", "operating_point", "probe", "tracks"),
            *("stands_in_for", "corrections"),
        )
        if name in optional and wrong is None:
            continue  # Egos of an earlier version do not tell them.
        if (name, wrong) in (("reference", None), ("demand", b"\x00")):
            continue  # Most algorithms need to know neither.
        maps = ("tokens", "timings", "wish", "uplink", "peers", "intent", "site", "understood")
        if name in maps and isinstance(wrong, dict):
            continue  # A map of fields that a later version may have.
        with pytest.raises(MessageError):
            decode(broken(sample, **{name: wrong}), type(sample))


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), float("-inf")])
@pytest.mark.parametrize("place", range(6))
def test_a_pose_that_is_not_finite_is_refused(bad: float, place: int) -> None:
    for kind in (Beacon, messages.SceneDescription, Observation):
        pose = [0.0] * 6
        pose[place] = bad
        with pytest.raises(MessageError, match="pose"):
            decode(broken(sample_of(kind), pose=pose), kind)


@pytest.mark.parametrize(
    ("kind", "name", "value"),
    [
        (Beacon, "velocity", [0.0, float("nan"), 0.0]),
        (Beacon, "range_m", float("inf")),
        (Beacon, "range_m", 0.0),
        (Beacon, "sizes", {"early": -1}),
        (Beacon, "sent_ns", -1),
        (Beacon, "sent_ns", 2**64 * 1.0),
        (Beacon, "seq", 1.5),
        (Beacon, "pose", [0.0] * 5),
        (Beacon, "robot", ""),
        (Beacon, "robot", "R1\n"),
        (Beacon, "robot", "a/b"),
        (Beacon, "robot", "x" * 33),
        (ObservationRequest, "algorithm", "Early"),
        (ObservationRequest, "max_error_m", 0.0),
        (ObservationRequest, "max_error_m", 1.5),
        (ObservationRequest, "max_error_m", float("nan")),
        (ObservationRequest, "max_bytes", 0),
        (Observation, "encode_ms", float("nan")),
        (Observation, "encode_ms", -1.0),
        (Decision, "participants", ["R1", "*"]),
        (Decision, "source", "guess"),
        (Decision, "quality", float("nan")),
        (Decision, "capacity_bps", 0.0),
        (messages.Detections, "latency_ms", float("inf")),
        (messages.NetState, "links", [{"robot": "R1", "direction": "down"}]),
        (messages.NetDemand, "unreachable_s", float("nan")),
        (messages.NetDemand, "quality", 1.5),
        (messages.ShapeRequest, "rate_bps", 0),
        (messages.ShapeRequest, "rate_bps", 1),
        (messages.ShapeRequest, "rate_bps", -5_000_000),
        (messages.ShapeRequest, "rate_bps", 10**12),
        (messages.ShapeRequest, "robot", "a/b"),
        (messages.ShapeRequest, "profile", "sawtooth"),
        (messages.ShapeRequest, "duration_s", float("inf")),
        (messages.ShapeRequest, "loss", 0.9),
        (messages.ShapeRequest, "interval_s", 0.0),
    ],
)
def test_a_value_out_of_range_is_refused(kind: type[Message], name: str, value: object) -> None:
    with pytest.raises(MessageError, match=kind.__name__):
        decode(broken(sample_of(kind), **{name: value}), kind)


def test_a_number_inside_a_part_of_a_message_must_be_finite() -> None:
    fields = plain(sample_of(messages.NetState))
    fields["links"][0]["latency_ms"] = float("nan")
    with pytest.raises(MessageError, match="links"):
        decode(msgpack.packb(fields), messages.NetState)


def test_an_oversized_message_is_refused_unread() -> None:
    with pytest.raises(MessageError, match=str(MAX_MESSAGE_BYTES)):
        decode(b"\xc1" * (MAX_MESSAGE_BYTES + 1), Beacon)


def test_a_message_of_another_kind_is_refused() -> None:
    for sample in SAMPLES:
        for kind in {type(other) for other in SAMPLES} - {type(sample)}:
            with pytest.raises(MessageError):
                decode(encode(sample), kind)


@given(st.binary(max_size=200), st.sampled_from(SAMPLES))
def test_garbage_raises_nothing_but_message_error(data: bytes, sample: Message) -> None:
    with pytest.raises(MessageError):
        decode(data, type(sample))


@given(st.sampled_from(SAMPLES), st.data())
def test_damaged_bytes_raise_only_message_error(sample: Message, data: st.DataObject) -> None:
    damaged = bytearray(encode(sample))
    for _ in range(data.draw(st.integers(1, 4))):
        damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    try:
        message = decode(bytes(damaged), type(sample))
    except MessageError:
        return
    assert type(message) is type(sample)


def test_a_deeply_nested_message_is_refused() -> None:
    with pytest.raises(MessageError):
        decode(b"\x81\xa1x" + b"\x91" * 100_000 + b"\xc0", Beacon)


@given(
    robot=robot_ids,
    numbers=st.tuples(counts, counts, times, times, counts),
    pose=st.tuples(*[bounded] * 6),
    velocity=st.tuples(*[bounded] * 3),
    range_m=positive,
    sizes=st.dictionaries(st.text(max_size=12), counts, max_size=4),
)
def test_a_beacon_survives_the_wire(
    robot: str,
    numbers: tuple[int, ...],
    pose: Any,
    velocity: Any,
    range_m: float,
    sizes: dict[str, int],
) -> None:
    instance, seq, sent, capture, frame = numbers
    beacon = Beacon(
        robot=robot,
        instance=instance,
        seq=seq,
        sent_ns=sent,
        capture_ns=capture,
        frame=frame,
        pose=pose,
        velocity=velocity,
        range_m=range_m,
        sizes=sizes,
    )
    assert decode(encode(beacon), Beacon) == beacon
    assert msgpack.packb(msgpack.unpackb(encode(beacon))) == encode(beacon)


@given(
    ids=st.lists(robot_ids, min_size=1, max_size=8),
    algorithm=st.from_regex(r"[a-z][a-z0-9-]{0,31}", fullmatch=True),
    reason=st.text(max_size=200),
    quality=finite,
    cost=counts,
)
def test_a_decision_survives_the_wire(
    ids: list[str], algorithm: Any, reason: str, quality: float, cost: int
) -> None:
    decision = Decision(
        ego=ids[0],
        cycle=1,
        decided_ns=1,
        participants=tuple(ids),
        algorithm=algorithm,
        reason=reason,
        source="policy",
        policy="coverage",
        valid=True,
        quality=quality,
        cost_bytes=cost,
    )
    assert decode(encode(decision), Decision) == decision


@given(payload=st.binary(max_size=4096), request=counts)
def test_an_observation_survives_the_wire(payload: bytes, request: int) -> None:
    observation = Observation(
        robot="R1",
        instance=0,
        request=request,
        algorithm="early",
        capture_ns=0,
        frame=0,
        pose=(0.0,) * 6,
        payload=payload,
        encode_ms=0.0,
    )
    assert decode(encode(observation), Observation) == observation


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("sent_ns", 2**62),
        ("capture_ns", 2**64 - 1),
        ("pose", [1e39, 0.0, 0.0, 0.0, 0.0, 0.0]),
        ("velocity", [0.0, -1e300, 0.0]),
        ("sizes", {f"a{i}": 1 for i in range(17)}),
        ("sizes", {"a" * 33: 1}),
    ],
)
def test_numbers_that_later_arithmetic_could_not_bear_are_refused(
    field: str, value: object
) -> None:
    sample = next(message for message in SAMPLES if isinstance(message, Beacon))
    fields = msgpack.unpackb(encode(sample))
    with pytest.raises(MessageError, match=field):
        decode(msgpack.packb(fields | {field: value}), Beacon)


FIRST_DECODING = """
import sys, threading
from swarm.messages import decode
from tests.support.message_samples import SAMPLES, golden_path

sys.setswitchinterval(1e-6)
for sample in SAMPLES:
    data, kind, together = golden_path(sample).read_bytes(), type(sample), threading.Barrier(4)
    heard = []

    def hear():
        together.wait()
        heard.append(decode(data, kind))

    threads = [threading.Thread(target=hear) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert heard == [sample] * 4
"""


def test_many_threads_may_be_the_first_to_decode_a_message() -> None:
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-c", FIRST_DECODING],
            cwd=REPOSITORY,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
        assert done.returncode == 0, f"exit {done.returncode}: {done.stderr}"
