"""Seeds of `make fuzz`: small inputs that the targets take, made by the project's own writers.

`python -m tests.support.fuzz_seeds` writes tests/fuzz/corpus anew; what lies there beside them
stays: each input that once was a finding.
"""

from __future__ import annotations

import io
import json
import sqlite3
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from mcap.writer import CompressionType, Writer

from ego_agent.knowledge.journal import CycleRecord, Decided, Frames, Inputs, Latency
from options.recordings.format import Frame, Header, RobotInFrame
from options.recordings.ranges import put_rays, put_scan
from perception.codec.boxes import encode_boxes
from perception.codec.envelope import unseal
from perception.codec.features import CellBlock, encode_cells
from perception.codec.outlined import add_outline
from perception.codec.points import encode_points
from perception.types import Boxes
from research.fuzz.targets import files, messages, payloads
from swarm.chunks import PART_BYTES, AskParts, MoreParts, split
from swarm.geometry import Pose
from tests.support.bag_files import CLOUD, ODOMETRY, STORE, TRANSFORMS, cloud, odometry, transforms
from tests.support.codec_scans import room_scan
from tests.support.message_samples import SAMPLES
from tests.support.paths import REPOSITORY
from worlds.base import Rays

CORPUS = REPOSITORY / "tests" / "fuzz" / "corpus"
_RANDOM = np.random.default_rng(5)
_FEW = np.round(_RANDOM.uniform(-20, 20, (12, 3)), 2).astype(np.float32)
_KINDS = [kind.__name__ for kind in messages.KINDS]

Seeds = Iterator[tuple[str, bytes]]


def message_seeds() -> Seeds:
    for sample in SAMPLES:
        kind = type(sample)
        number = _KINDS.index(kind.__name__)
        yield kind.__name__.lower(), bytes((number,)) + msgspec.msgpack.encode(sample)


def field_seeds() -> Seeds:
    for name, packed in message_seeds():
        values = _told(msgspec.msgpack.decode(packed[1:]))
        yield name, packed[:1] + json.dumps(values, ensure_ascii=False).encode()


def _told(value: Any) -> Any:
    """Bytes as the target `fields` reads them."""
    if isinstance(value, dict):
        return {key: _told(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_told(item) for item in value]
    return "b:AAAA" if isinstance(value, bytes) else value


def chunk_seeds() -> Seeds:
    def packed(*parts: bytes) -> bytes:
        return b"".join(bytes((len(part),)) + part for part in parts)

    whole = split(bytes(2 * PART_BYTES))
    heads = [head or b"" for head, _ in whole]
    # Of two parts with three bytes in all, which an input can hold.
    small = [head[:5] + (3).to_bytes(4, "little") for head in heads]
    yield "two-parts", packed(small[0], b"ab", small[1], b"c")
    yield "reversed", packed(small[1], b"c", small[0], b"ab")
    yield "queries", packed(AskParts(7, 1.5, 3).pack(), b"", MoreParts(7, 9).pack(), b"")


def array_seeds() -> Seeds:
    table = np.arange(6, dtype=np.float32).reshape(2, 3)
    yield "table", b"<f4 2 3\0" + table.tobytes()
    yield "empty", b"<f4 0 3\0"
    yield "counts", b"<u2 4\0" + bytes(8)


def key_seeds() -> Seeds:
    yield "beacon", b"coadapt/local/robot/R1/beacon"
    yield "decision", b"coadapt/local/ego/R1/decision"
    yield "swarm", b"local"


def point_seeds() -> Seeds:
    few = encode_points(_FEW, 0.05)
    scan = encode_points(room_scan(rings=4, columns=90), 0.1)
    for name, payload in {"few": few, "scan": scan, "none": encode_points(_FEW[:0])}.items():
        kind, body = unseal(payload)
        yield name, bytes((kind,)) + body
    yield "outlined", b"\x80" + add_outline(few, np.zeros((2, 2)))


def box_seeds() -> Seeds:
    boxes = Boxes(
        centers=np.array([[1.0, 2.0, 0.5], [-3.0, 4.0, 1.0]]),
        sizes=np.ones((2, 3)),
        headings=np.array([0.5, 3.0]),
        scores=np.array([0.9, 0.2]),
        labels=("robot", "forklift"),
    )
    for name, these in {"two": boxes, "none": boxes.take(np.zeros(0, dtype=np.intp))}.items():
        kind, body = unseal(encode_boxes(these))
        yield name, bytes((kind,)) + body


def feature_seeds() -> Seeds:
    present = np.zeros(payloads.SHAPE, dtype=np.bool_)
    present[3:5, 4:9] = True
    values = _RANDOM.integers(0, 16, (payloads.CHANNELS, 10), dtype=np.uint8)
    steps = CellBlock(
        payloads.WEIGHTS, payloads.SHAPE, (1, 2, 0, 0, 0, 0.5), present, values, coded=False
    )
    for block in (steps, replace(steps, values=values[: payloads.PARTS], coded=True)):
        for numerics in ("float32", "bfloat16"):
            kind, body = unseal(encode_cells(replace(block, numerics=numerics)))
            yield f"{'codes' if block.coded else 'steps'}-{numerics}", bytes((kind,)) + body
    head = unseal(encode_cells(steps))[1][:40]
    bits = np.packbits(present).tobytes()
    yield "plain", bytes((32 | 0x80,)) + head + bits + bytes(30)


def ros_seeds() -> Seeds:
    stamp = 1_700_000_000_000_000_000
    told = {
        CLOUD: cloud(stamp, _FEW),
        ODOMETRY: odometry(stamp, Pose(1, 2, 0)),
        TRANSFORMS: transforms(stamp, {("base_link", "lidar"): Pose(0.2, 0, 1.2)}),
    }
    for number, (kind, message) in enumerate(told.items()):
        raw = STORE.serialize_cdr(message, kind)
        yield kind.rpartition("/")[2].lower(), bytes((number,)) + bytes(raw)
    yield "foxglove", b"\4" + foxglove_cloud()
    attachment = (1).to_bytes(8, "little") + (2).to_bytes(8, "little") + b"\x10" + bytes(16)
    yield "attachment", b"\5" + attachment
    yield "token", b"\5@ros2_lv/0/s/0/1/MP/%/%/node/%points/sensor_msgs::msg::dds_::X_/RIHS/::,"
    yield "address", b"\x06192.0.2.7:7447/3?points=/points&odom=/odom&sensor=0,0,1.2"


def foxglove_cloud() -> bytes:
    """Twelve points in protobuf, as `foxglove.PointCloud`: stride, three fields, the data."""

    def element(name: str, offset: int) -> bytes:
        body = b"\x0a\x01" + name.encode() + b"\x15" + offset.to_bytes(4, "little") + b"\x18\x07"
        return b"\x2a" + bytes((len(body),)) + body

    parts = b"".join(element(name, 4 * at) for at, name in enumerate("xyz"))
    data = _FEW.tobytes()
    return b"\x25" + (12).to_bytes(4, "little") + parts + b"\x32\x90\x01" + data


def bag_seeds() -> Seeds:
    rows = [
        ("/points", CLOUD, cloud(10**9, _FEW[:4])),
        ("/odom", ODOMETRY, odometry(10**9, Pose(1, 2, 0))),
    ]
    for name, packing in {"plain": CompressionType.NONE, "zstd": CompressionType.ZSTD}.items():
        yield (
            f"mcap-{name}",
            b"\0"
            + mcap(
                [
                    (topic, "cdr", kind, bytes(STORE.serialize_cdr(said, kind)))
                    for topic, kind, said in rows
                ],
                packing,
            ),
        )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "bag.db3")
        with sqlite3.connect(path) as database:
            # Small pages: the file has a few kilobytes.
            database.execute("PRAGMA page_size=512")
            database.execute(
                "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, "
                "type TEXT NOT NULL, serialization_format TEXT NOT NULL)"
            )
            database.execute(
                "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, "
                "timestamp INTEGER NOT NULL, data BLOB NOT NULL)"
            )
            for number, (topic, kind, said) in enumerate(rows, start=1):
                raw = bytes(STORE.serialize_cdr(said, kind))
                database.execute("INSERT INTO topics VALUES(?, ?, ?, 'cdr')", (number, topic, kind))
                database.execute("INSERT INTO messages VALUES(?, ?, 9, ?)", (number, number, raw))
        database.close()
        yield "sqlite", b"\1" + path.read_bytes()


def mcap(
    rows: list[tuple[str, str, str, bytes]], packing: CompressionType = CompressionType.NONE
) -> bytes:
    """A file of these messages: topic, encoding, schema's name and bytes, one a nanosecond."""
    file = io.BytesIO()
    writer = Writer(file, compression=packing)
    writer.start()
    for number, (topic, encoding, kind, raw) in enumerate(rows, start=1):
        schema = writer.register_schema(kind, encoding, b"")
        channel = writer.register_channel(topic, encoding, schema)
        writer.add_message(channel, 5, bytes(raw), 5, number)
    writer.finish()
    return file.getvalue()


def recording_seeds() -> Seeds:
    header = Header(
        swarm="local", ego="R1", robots=("R1", "R2"), world="factory", epoch_ns=0, points="all",
        rate_hz=10.0, range_m=30.0, detector="factory", comm_range_m=40.0, started_ns=1,
    )  # fmt: skip
    turn = np.arange(8) * (np.pi / 4)
    ring = np.stack([np.cos(turn), np.sin(turn), np.zeros(8)], axis=-1)
    above = ring * 0.8 + np.array([0.0, 0.0, 0.6])
    rays = Rays(np.stack([ring, above]).astype(np.float32), 0.25)
    scan = rays.directions.reshape(-1, 3)[[0, 2, 9]] * np.float32(3.0)
    ranges = put_scan(scan, rays)
    robot = RobotInFrame(pose=(1, 2, 0, 0, 0, 0), velocity=(0, 0, 0), points=3)
    frame = Frame(frame=1, capture_ns=5, robots={"R1": robot, "R2": robot})
    said: list[tuple[str, Any]] = [("/recording", header), ("/rays", put_rays(rays))]
    said += [("/robot/R1/ranges", ranges), ("/frame", frame)] if ranges else [("/frame", frame)]
    rows = [(topic, "json", topic[1:], msgspec.json.encode(what)) for topic, what in said]
    rows.append(("/robot/R2/points", "protobuf", "foxglove.PointCloud", foxglove_cloud()))
    yield "ranges-and-points", mcap(rows)
    yield "zstd", mcap(rows, CompressionType.ZSTD)


def scan_seeds() -> Seeds:
    head = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\n"
    head += "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA "
    two = _FEW[:2]
    yield "pcd-ascii", b"\0" + f"{head}ascii\n1 2 3\n4 5 6\n".encode()
    yield "pcd-binary", b"\0" + f"{head}binary\n".encode() + two.tobytes()
    plain = np.ascontiguousarray(two.T).tobytes()
    packed = bytes((len(plain) - 1,)) + plain
    sizes = len(packed).to_bytes(4, "little") + len(plain).to_bytes(4, "little")
    yield "pcd-compressed", b"\0" + f"{head}binary_compressed\n".encode() + sizes + packed
    ply = "element vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    yield "ply-ascii", b"\1" + f"ply\nformat ascii 1.0\n{ply}1 2 3\n4 5 6\n".encode()
    yield (
        "ply-binary",
        b"\1" + f"ply\nformat binary_little_endian 1.0\n{ply}".encode() + two.tobytes(),
    )
    buffer = io.BytesIO()
    np.save(buffer, two)
    yield "npy", b"\2" + buffer.getvalue()
    yield "kitti", b"\3" + np.abs(np.hstack([two, two[:, :1]])).astype("<f4").tobytes()
    yield "nuscenes", b"\4" + np.abs(np.hstack([two, two[:, :2]])).astype("<f4").tobytes()


def table_seeds() -> Seeds:
    buffer = io.BytesIO()
    np.save(buffer, np.eye(4)[None])
    scene = json.loads((REPOSITORY / "docs" / "example-scene.json").read_text())
    texts = {
        "poses.txt": b"1 0 0 5 0 1 0 0 0 0 1 1\n" * 2,
        "poses.csv": b"x,y,z,yaw\n1,2,0,0.5\n2,2,0,0.5\n",
        "poses.npy": buffer.getvalue(),
        "world.toml": b'rate_hz = 10.0\ndetector = "road"\n[robots.R1]\nclock_offset_s = 1.0\n',
        "trace": b"0\n3\n3\n900\n2100\n",
        "scene.json": json.dumps(scene).encode(),
    }
    for name, text in texts.items():
        yield name, bytes((files.TABLES.index(name),)) + text


def journal_seeds() -> Seeds:
    record = CycleRecord(
        ego="R1",
        cycle=1,
        started_ns=1,
        inputs=Inputs(
            robots={}, excluded={"R2": "gone"}, capacity_bps=5e6, capacity_source="prior"
        ),
        decision=Decided(
            participants=("R1",),
            algorithm="early",
            reason="alone",
            source="policy",
            policy="coverage",
            valid=True,
            repairs=(),
            quality=0.9,
            cost_bytes=0,
        ),
        published=True,
        bytes={"R2": {"early": 100}},
        frames=Frames(fused=10, skipped=0, failed=0, late_answers=0, boxes=4),
        missing={},
        latency=Latency(cycle_ms=1.0, frame_p50_ms=None, frame_max_ms=None),
        outcome="complete",
    )
    line = msgspec.json.encode(record) + b"\n"
    yield "line", line
    yield "torn", line + line[:40]


def answer_seeds() -> Seeds:
    answer = {"algorithm": "early", "helpers": ["R2"], "explanation": "it sees", "confidence": 0.7}
    text = json.dumps(answer)
    yield "plain", text.encode()
    yield "fenced", f"<think>R2?</think>Here it is:\n```json\n{text}\n```".encode()
    yield "words", text.replace("0.7", '"high"').encode()


def chat_seeds() -> Seeds:
    asked = {
        "messages": [{"role": "user", "content": "Which robots?"}], "max_tokens": 64, "seed": 3,
        "response_format": {"type": "json_schema", "json_schema": {"schema": {"type": "object"}}},
        "temperature": 0.5, "stop": ["\n"],
    }  # fmt: skip
    yield "request", b"\0" + json.dumps(asked).encode()
    reply = {
        "choices": [{"message": {"role": "assistant", "content": "{}"}, "finish_reason": "stop"}],
        "usage": {"prompt_tokens": 9, "completion_tokens": 2, "total_tokens": 11},
    }
    yield "reply", b"\1" + json.dumps(reply).encode()
    yield "models", b'\2{"object": "list", "data": [{"id": "m"}]}'


def qod_seeds() -> Seeds:
    device = {
        "ipv4Address": {"publicAddress": "192.0.2.1", "privateAddress": "10.77.1.2"},
        "phoneNumber": "+123456789",
        "ipv6Address": "2001:db8::1",
    }
    session = {
        "device": device, "applicationServer": {"ipv4Address": "10.77.2.0/24"},
        "devicePorts": {"ranges": [{"from": 5, "to": 9}], "ports": [80]}, "qosProfile": "QOS_E",
        "sink": "https://sink.example/events", "duration": 60,
        "sinkCredential": {"credentialType": "ACCESSTOKEN", "accessToken": "t",
                           "accessTokenExpiresUtc": "2030-01-01T00:00:00Z",
                           "accessTokenType": "bearer"},
    }  # fmt: skip
    bodies = [session, {"requestedAdditionalDuration": 60}, {"device": device}, {"name": "QOS_E"}]
    for number, body in enumerate(bodies):
        yield f"body-{number}", bytes((number,)) + json.dumps(body).encode()


SEEDS = {
    "answers": answer_seeds, "arrays": array_seeds, "bags": bag_seeds, "boxes": box_seeds,
    "chat": chat_seeds, "chunks": chunk_seeds, "features": feature_seeds, "fields": field_seeds,
    "journals": journal_seeds, "keys": key_seeds, "messages": message_seeds, "points": point_seeds,
    "qod": qod_seeds, "recordings": recording_seeds, "ros": ros_seeds, "scans": scan_seeds,
    "tables": table_seeds,
}  # fmt: skip


def main() -> None:
    for target, seeds in SEEDS.items():
        folder = CORPUS / target
        folder.mkdir(parents=True, exist_ok=True)
        for name, data in seeds():
            (folder / name).write_bytes(data)


if __name__ == "__main__":
    main()
