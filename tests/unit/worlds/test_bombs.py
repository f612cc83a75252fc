"""Files that announce or unpack to far more than they hold end with an error that names them, and
cost next to nothing. Each is read by a process of its own, whose memory is measured."""

from __future__ import annotations

import functools
import io
import resource
import sqlite3
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer

from tests.support.paths import REPOSITORY

MAX_RSS_KB = 200_000
CPU_S = 60
"""A reader that never ends is killed by the kernel, however slow the machine."""
TIB = 1 << 40
READ = """
import sys
from pathlib import Path
{program}
with open("/proc/self/status") as status:
    peak = next(line.split()[1] for line in status if line.startswith("VmHWM"))
print("peak", peak)
"""
SCAN = """
from swarm.errors import WorldError
from worlds.scans import read_scan
try:
    read_scan(Path(sys.argv[1]))
except WorldError as error:
    print("error", error)
"""
BAG = """
from options.bags.recording import Recording
from swarm.errors import WorldError
try:
    bag = Recording(Path(sys.argv[1]))
    for topic in bag.topics:
        messages = bag.messages(topic)
        for index in range(len(messages)):
            messages.decode(index, len)
    print("error", *bag.notes)
except WorldError as error:
    print("error", error)
"""
POSES = """
from swarm.errors import WorldError
from worlds.plain.poses import read_poses
try:
    read_poses(Path(sys.argv[1]))
except WorldError as error:
    print("error", error)
"""


def told(program: str, path: Path) -> str:
    """What a process says of a file; it may not have needed more than MAX_RSS_KB."""
    done = subprocess.run(
        [sys.executable, "-c", READ.format(program=program), str(path)],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S)),
    )
    assert done.returncode == 0, done.stderr[-2000:]
    lines = dict(line.split(" ", 1) for line in done.stdout.splitlines() if " " in line)
    assert int(lines["peak"]) < MAX_RSS_KB, done.stdout[-500:]
    return lines.get("error", "")


def npy(shape: tuple[int, ...], kind: object = "<f4", body: bytes = b"") -> bytes:
    header = io.BytesIO()
    described = {"descr": kind, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_2_0(header, described)
    return header.getvalue() + body


def pcd(points: int, data: str, body: bytes, count: str = "1") -> bytes:
    return (
        f"VERSION 0.7\nFIELDS x y z i\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 {count}\n"
        f"WIDTH {points}\nHEIGHT 1\nPOINTS {points}\nDATA {data}\n"
    ).encode() + body


def ply(vertices: int, form: str = "binary_little_endian", before: str = "") -> bytes:
    return (
        f"ply\nformat {form} 1.0\n{before}element vertex {vertices}\n"
        "property float x\nproperty float y\nproperty float z\nend_header\n"
    ).encode() + bytes(120)


FIELDS = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]
SCANS: dict[str, bytes] = {
    "terabytes.npy": npy((10**12, 3)),
    "exabytes.npy": npy((10**18, 3), body=bytes(120)),
    "wide.npy": npy((4, 10**11), body=bytes(120)),
    "fields.npy": npy((10**12,), FIELDS),
    "empty.npy": npy((0, 10**12)),
    "header.npy": b"\x93NUMPY\x02\x00\xff\xff\xff\xff",
    "zip.npy": b"PK\x03\x04" + bytes(200),
    "count.pcd": pcd(12_000_000, "binary", bytes(64)),
    "points.pcd": pcd(10**15, "binary", bytes(64)),
    "fields.pcd": pcd(12_000_000, "binary", bytes(64), "1000000000"),
    "digits.pcd": pcd(1, "binary", bytes(64), "9" * 3000),
    "ascii.pcd": pcd(12_000_000, "ascii", b"1 2 3 4\n"),
    "text.pcd": pcd(1, "ascii", b"1 " * 10_000_000),
    "packed.pcd": pcd(
        12_000_000,
        "binary_compressed",
        struct.pack("<II", 1000, 192_000_000) + b"\x00\x00" + b"\xe0\xff\x00" * 300_000,
    ),
    "most.pcd": pcd(
        1_000_000,
        "binary_compressed",
        struct.pack("<II", 1000, 4_012_000_000) + b"\x00\x00" + b"\xe0\xff\x00" * 3_000_000,
        "1000",
    ),
    "vertices.ply": ply(12_000_000),
    "more.ply": ply(10**12),
    "digits.ply": ply(1).replace(b"vertex 1", b"vertex " + b"9" * 60_000),
    "before.ply": ply(1, before="element edge 12000000\nproperty double a\n"),
    "ascii.ply": ply(12_000_000, "ascii"),
    "odd.bin": bytes(1_000_001),
}


@pytest.mark.parametrize("name", SCANS)
def test_a_scan_that_promises_more_than_it_holds_is_refused(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(SCANS[name])
    assert str(path) in told(SCAN, path)


@pytest.mark.parametrize("name", ["huge.npy", "huge.pcd", "huge.ply", "huge.bin"])
def test_a_scan_with_a_hole_of_a_terabyte_is_refused(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    begins = {".npy": npy((TIB // 12, 3)), ".pcd": pcd(1, "binary", b""), ".ply": ply(1)}
    path.write_bytes(begins.get(path.suffix, b""))
    hollow(path)
    assert str(path) in told(SCAN, path)


def hollow(path: Path) -> None:
    """Makes a file a terabyte long, of which the disk holds nothing."""
    try:
        with path.open("r+b") as file:
            file.truncate(TIB)
    except OSError as error:
        pytest.skip(f"this file system has no such files: {error}")


@pytest.mark.parametrize("shape", [(10**12, 12), (10**12, 4, 4)])
def test_poses_that_promise_more_than_they_hold_are_refused(
    tmp_path: Path, shape: tuple[int, ...]
) -> None:
    path = tmp_path / "poses.npy"
    path.write_bytes(npy(shape))
    assert str(path) in told(POSES, path)


def chunk(content: bytes, compression: str, announced: int) -> bytes:
    """A chunk of an MCAP file with whatever content."""
    name = compression.encode()
    head = struct.pack("<QQQII", 0, 1, announced, 0, len(name)) + name
    body = head + struct.pack("<Q", len(content)) + content
    return struct.pack("<BQ", Opcode.CHUNK, len(body)) + body


MUCH = 512 << 20


@functools.cache
def zeros() -> bytes:
    return zstandard.ZstdCompressor().compress(bytes(MUCH))


def streamed(total: int) -> bytes:
    """Zeros of which the frame does not tell how many they are."""
    packer = zstandard.ZstdCompressor().compressobj()
    part = bytes(1 << 20)
    return b"".join([*(packer.compress(part) for _ in range(total >> 20)), packer.flush()])


def lz4_zeros() -> bytes:
    return lz4.frame.compress(bytes(MUCH))


def endless() -> bytes:
    """Records without content, 9 bytes each, as many as fit."""
    return zstandard.ZstdCompressor().compress(struct.pack("<BQ", 0x80, 0) * 7_000_000)


CHUNKS: dict[str, Callable[[], bytes]] = {
    "zstd": lambda: chunk(zeros(), "zstd", MUCH),
    "zstd-lies": lambda: chunk(zeros(), "zstd", 1000),
    "zstd-streamed": lambda: chunk(streamed(MUCH), "zstd", 1000),
    "zstd-half": lambda: chunk(streamed(32 << 20), "zstd", 32 << 20),
    "zstd-terabytes": lambda: chunk(streamed(1 << 20), "zstd", TIB),
    "lz4": lambda: chunk(lz4_zeros(), "lz4", MUCH),
    "lz4-lies": lambda: chunk(lz4_zeros(), "lz4", 1000),
    "records": lambda: chunk(endless(), "zstd", 63_000_000),
    "plain": lambda: chunk(b"", "", 0)[:9] + bytes(100),
}


@pytest.mark.parametrize("name", CHUNKS)
def test_a_chunk_that_unpacks_to_far_more_than_it_has_is_refused(tmp_path: Path, name: str) -> None:
    path = tmp_path / f"{name}.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + CHUNKS[name]())
    assert str(path) in told(BAG, path)


def test_an_mcap_file_that_is_a_hole_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "hole.mcap"
    path.write_bytes(b"\x89MCAP0\r\n")
    hollow(path)
    assert str(path) in told(BAG, path)


def test_an_indexed_bomb_is_refused_when_its_messages_are_read(tmp_path: Path) -> None:
    path = tmp_path / "indexed.mcap"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=MUCH, compression=CompressionType.ZSTD)
        writer.start()
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        channel = writer.register_channel("/points", "cdr", schema)
        for number in range(3):
            writer.add_message(channel, number, bytes(24 << 20), number)
        writer.finish()
    assert str(path) in told(BAG, path)


def bag(path: Path, blob_bytes: int) -> None:
    with sqlite3.connect(path) as database:
        database.executescript(
            "CREATE TABLE topics (id INTEGER PRIMARY KEY, name TEXT, type TEXT, "
            "serialization_format TEXT, offered_qos_profiles TEXT);"
            "CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, "
            "data BLOB);"
            "INSERT INTO topics VALUES (1, '/points', 'sensor_msgs/msg/PointCloud2', 'cdr', '');"
        )
        database.execute("INSERT INTO messages VALUES (1, 1, 5, zeroblob(?))", (blob_bytes,))


def test_a_giant_blob_of_a_bag_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "giant.db3"
    bag(path, 80 << 20)
    assert str(path) in told(BAG, path)


def test_a_compressed_message_that_unpacks_to_far_more_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "packed"
    folder.mkdir()
    bag(folder / "packed.db3", 1)
    with sqlite3.connect(folder / "packed.db3") as database:
        database.execute("UPDATE messages SET data = ?", (zeros(),))
    (folder / "metadata.yaml").write_text(
        "rosbag2_bagfile_information:\n  relative_file_paths: [packed.db3]\n"
        "  compression_mode: message\n  compression_format: zstd\n"
    )
    assert str(folder) in told(BAG, folder)
