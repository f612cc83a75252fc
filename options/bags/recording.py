"""One bag: a file, or a rosbag2 directory of files that follow each other."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import yaml
import zstandard

from options.bags.mcap_file import McapFile
from options.bags.sqlite import SqliteFile
from options.bags.storage import Storage
from options.bags.unpack import unzstd
from options.ros.cdr import CdrError
from swarm.errors import WorldError
from worlds.robot_name import check_robot_name

T = TypeVar("T")

_KINDS: dict[str, Callable[[Path], Storage]] = {".db3": SqliteFile, ".mcap": McapFile}
_METADATA = "metadata.yaml"


def find_bags(folder: Path) -> dict[str, Path]:
    """The bag of each robot by the robot's name: sub-directories and files of a folder.

    Raises WorldError when there is none, or one that cannot be a robot's.
    """
    try:
        entries = sorted(folder.iterdir())
    except OSError as error:
        raise WorldError(f"data directory {folder} cannot be read: {error}") from error
    if (folder / _METADATA).is_file():
        raise WorldError(
            f"data directory {folder} is itself a bag (it has {_METADATA}); give the folder that "
            "holds one bag a robot"
        )
    found: dict[str, Path] = {}
    for path in entries:
        if path.name.startswith("."):
            continue
        if path.is_file() and path.suffix == ".bag":
            raise WorldError(
                f"{path} is a bag of ROS 1; convert it (rosbags-convert --src {path.name} "
                f"--dst {path.stem})"
            )
        if not (path.suffix in _KINDS if path.is_file() else _bag_files(path)):
            continue
        name = path.name if path.is_dir() else path.stem
        check_robot_name(f"bag {path}", name)
        if name in found:
            raise WorldError(f"{found[name]} and {path} are both bags of robot {name!r}; keep one")
        found[name] = path
    if not found:
        raise WorldError(
            f"data directory {folder} holds no bags: neither rosbag2 directories nor "
            ".mcap or .db3 files"
        )
    return found


class Recording:
    """The messages of one bag by topic, in the order in which they were recorded."""

    def __init__(self, path: Path) -> None:
        """Opens a bag. Raises WorldError when it cannot be read."""
        self.path = path
        self._packed = False
        files = self._files() if path.is_dir() else [path]
        self._storages = [_KINDS[file.suffix](file) for file in files]
        self.notes = tuple(
            f"{file} is cut off ({storage.cut}); what comes before is used"
            for file, storage in zip(files, self._storages, strict=True)
            if storage.cut
        )
        """What is wrong with a bag that can be used all the same."""
        self.topics = {k: v for storage in self._storages for k, v in storage.topics.items()}
        """The type of each topic that has messages."""

    def topics_of(self, kind: str) -> list[str]:
        """The topics of a type."""
        return sorted(topic for topic, its in self.topics.items() if its == kind)

    def messages(self, topic: str) -> Messages:
        """The messages of one of the topics."""
        return Messages(self, topic, self._storages, self._packed)

    def _files(self) -> list[Path]:
        """The files of a directory, in the order that its metadata says, else by number: a
        recorder that was killed leaves no metadata."""
        there = _bag_files(self.path)
        metadata = self.path / _METADATA
        if not metadata.is_file():
            return [path for path in there if path.suffix in _KINDS]
        try:
            facts = yaml.safe_load(metadata.read_text())["rosbag2_bagfile_information"]
            names = [Path(name).name for name in facts["relative_file_paths"]]
            mode = str(facts.get("compression_mode") or "none").lower()
            form = str(facts.get("compression_format") or "")
        except (OSError, UnicodeDecodeError, yaml.YAMLError, LookupError, TypeError) as error:
            raise WorldError(f"{metadata} cannot be read: {error!r}") from error
        if mode == "file":
            raise WorldError(
                f"bag {self.path} is compressed file by file, which is not read; allowed: none and "
                "message (ros2 bag convert)"
            )
        if mode == "message":
            if form != "zstd":
                raise WorldError(f"bag {self.path} is compressed with {form!r}; allowed: zstd")
            self._packed = True
        for name in names:
            if self.path / name not in there or Path(name).suffix not in _KINDS:
                raise WorldError(
                    f"{metadata} names {name}, which is not there as a .db3 or .mcap file"
                )
        return [self.path / name for name in names]


class Messages:
    """The messages of one topic; each is read when it is asked for."""

    def __init__(
        self, recording: Recording, topic: str, storages: list[Storage], packed: bool
    ) -> None:
        """Reads where they are, but none of them."""
        self._storages = [storage for storage in storages if topic in storage.topics]
        self._packed = packed
        self.topic = topic
        self.files = tuple(storage.path for storage in self._storages)
        """Those that hold messages of the topic."""
        self._what = f"topic {topic} of bag {recording.path}"
        indexes = [storage.index(topic) for storage in self._storages]
        times = np.concatenate([index.times_ns for index in indexes])
        owners = np.repeat(np.arange(len(indexes)), [len(index) for index in indexes])
        order = np.argsort(times, kind="stable")
        self.times_ns = times[order]
        """int64 (N,): when each was recorded."""
        self._owners = owners[order]
        self._places = np.concatenate([index.places for index in indexes])[order]

    def __len__(self) -> int:
        return len(self.times_ns)

    def decode(self, index: int, read: Callable[[bytes], T], most: int | None = None) -> T:
        """What `read` makes of a message, or of its first `most` bytes.

        Raises WorldError that names the message when it is malformed.
        """
        first, second = (int(value) for value in self._places[index])
        storage = self._storages[self._owners[index]]
        raw = storage.read((first, second), None if self._packed else most)
        try:
            return read(unzstd(raw) if self._packed else raw)
        except (CdrError, struct.error, zstandard.ZstdError, MemoryError, ValueError) as error:
            # A packed message may say that it unpacks to more than there is memory for.
            why = str(error) or repr(error)
            raise WorldError(f"message {index} of {self._what} is malformed: {why}") from error


def _bag_files(path: Path) -> list[Path]:
    """What of a directory belongs to a bag, `x_2.db3` before `x_10.db3`. Raises WorldError."""

    def number(file: Path) -> tuple[Any, ...]:
        parts = re.split(r"(\d+)", file.name)
        return tuple((not part.isdigit(), int(part) if part.isdigit() else part) for part in parts)

    if not path.is_dir():
        return []
    try:
        files = [file for file in path.iterdir() if file.name != _METADATA]
    except OSError as error:
        raise WorldError(f"{path} cannot be read: {error}") from error
    ends = (*_KINDS, *(f"{suffix}.zstd" for suffix in _KINDS))
    return sorted((file for file in files if file.name.endswith(ends)), key=number)
