"""Targets: files of others, written where temporary files lie."""

from __future__ import annotations

import atexit
import shutil
import tempfile
from functools import cache
from pathlib import Path

import numpy as np

from ego_agent.analyze.scene_file import read_scene
from ego_agent.knowledge.journal import read_journal
from network_controller.mahimahi import read_trace
from options.bags.recording import Recording
from options.bags.settings import read_settings
from options.recordings.file import RecordingFile
from options.recordings.format import FRAME
from options.ros import messages as ros
from research.fuzz.target import Target
from swarm.errors import DecisionError, JournalError, NetworkError, WorldError
from worlds.plain.poses import read_poses
from worlds.scans import read_scan

MAX_MESSAGES = 20
"""Of a topic: a file of a few kilobytes may name thousands of places."""
SCANS = (".pcd", ".ply", ".npy", ".bin", ".pcd.bin")
BAGS = (".mcap", ".db3")
TABLES = ("poses.txt", "poses.csv", "poses.npy", "world.toml", "trace", "scene.json")


@cache
def _folder() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="coadapt-fuzz-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def _file(name: str, data: bytes) -> Path:
    path = _folder() / name
    path.write_bytes(data)
    return path


def _scan(data: bytes) -> None:
    """One byte for the kind of file."""
    if data:
        path = _file(f"scan{SCANS[data[0] % len(SCANS)]}", data[1:])
        points = read_scan(path)
        assert points.dtype == np.float32
        assert np.isfinite(points).all()


def _bag(data: bytes) -> None:
    """One byte for the kind of file."""
    if not data:
        return
    recording = Recording(_file(f"bag{BAGS[data[0] % len(BAGS)]}", data[1:]))
    readers = {
        ros.CLOUD: ros.read_cloud,
        ros.ODOMETRY: ros.read_odometry,
        ros.TRANSFORMS: ros.read_transforms,
    }
    for topic, kind in recording.topics.items():
        messages = recording.messages(topic)
        for index in range(min(len(messages), MAX_MESSAGES)):
            messages.decode(index, ros.read_stamp, ros.STAMP_BYTES)
            messages.decode(index, readers.get(kind, ros.read_frame))


def _recording(data: bytes) -> None:
    file = RecordingFile(_file("recording.mcap", data))
    for time_ns in file.times(FRAME)[:MAX_MESSAGES]:
        for robot in file.frame(time_ns).robots:
            assert file.points(robot, time_ns).shape[1] == 3


def _table(data: bytes) -> None:
    """One byte for the kind of file."""
    if not data:
        return
    name = TABLES[data[0] % len(TABLES)]
    path = _file(name, data[1:])
    if name.startswith("poses"):
        assert np.isfinite(np.stack(read_poses(path))).all()
    elif name == "world.toml":
        read_settings(path.parent, ("R1", "R2"))
    elif name == "trace":
        assert min(read_trace(path)) >= 0
    else:
        read_scene(data[1:], now_ns=1_800_000_000_000_000_000)


def _journal(data: bytes) -> None:
    for record in read_journal(_file("journal.jsonl", data)):
        assert record.ego


SCAN_FILES = Target(_scan, (WorldError,))
BAG_FILES = Target(_bag, (WorldError,), max_bytes=16_384)
RECORDINGS = Target(_recording, (WorldError,), max_bytes=16_384)
JOURNALS = Target(_journal, (JournalError,), json_from=0)
TABLE_FILES = Target(_table, (WorldError, NetworkError, DecisionError))
