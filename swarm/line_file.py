"""A file of lines that one process appends to: what was written survives a crash, and the file does
not grow without end.

A full file becomes `<path>.1`, what that was `<path>.2`, and so on; the oldest goes. Locks, errors
and durability are the same for all journals of the swarm.
"""

from __future__ import annotations

import fcntl
import glob
import os
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

PART_BYTES = 16_000_000
PARTS = 20
"""Full parts that are kept: with the one that is written, 336 MB at most."""
_PROBE = b" " * 4096


class LineFile:
    """The writing end, locked against a second writer. Not for several threads."""

    def __init__(self, path: Path, *, part_bytes: int = PART_BYTES, parts: int = PARTS) -> None:
        """Opens or makes the file, and its directory. What it holds counts only when `keep` has
        said how much of it is whole.

        Raises OSError, and BlockingIOError where another process writes it.
        """
        self.path = path
        self.size = 0
        """Bytes of whole lines."""
        self._part_bytes = part_bytes
        self._parts = parts
        path.parent.mkdir(parents=True, exist_ok=True)
        self._fd = _open_locked(path)

    @property
    def is_full(self) -> bool:
        """Whether `rotate` is due."""
        return self.size >= self._part_bytes

    def keep(self, size: int) -> None:
        """Goes on behind so many bytes; what lies behind them goes. Finds out now, not in an hour,
        that the disk is full. Raises OSError."""
        self.size = size
        _sync_directory(self.path)
        try:
            self._write(_PROBE)
        finally:
            os.ftruncate(self._fd, size)

    def append(self, lines: bytes) -> None:
        """Puts whole lines on the disk. Raises OSError; nothing of them counts then."""
        self._write(lines)
        self.size += len(lines)

    def rotate(self) -> None:
        """Begins a new file; this one becomes the newest of the parts. Raises OSError; then the
        same file goes on."""
        fresh = self.path.with_name(f"{self.path.name}.new")
        fresh.unlink(missing_ok=True)
        fd = _open_locked(fresh)
        try:
            for number in range(self._parts, 1, -1):
                with suppress(FileNotFoundError):
                    _part(self.path, number - 1).replace(_part(self.path, number))
            # A second name first: there is a file of this name at any moment.
            _part(self.path, 1).unlink(missing_ok=True)
            os.link(self.path, _part(self.path, 1))
            fresh.replace(self.path)
            _sync_directory(self.path)
        except OSError:
            os.close(fd)
            raise
        os.close(self._fd)
        self._fd, self.size = fd, 0

    def close(self) -> None:
        """Closes the file and lets go of the lock."""
        os.close(self._fd)

    def _write(self, data: bytes) -> None:
        # Anything that a failed attempt left behind the last good line goes first.
        os.ftruncate(self._fd, self.size)
        os.lseek(self._fd, self.size, os.SEEK_SET)
        view = memoryview(data)
        while view:
            view = view[os.write(self._fd, view) :]
        os.fsync(self._fd)


def open_parts(path: Path) -> list[tuple[Path, BinaryIO]]:
    """The files that hold what was written to a path, open to be read, the oldest first. Raises
    OSError where the path is not there, or cannot be read.

    Names move on when a file is full: that no part is left out, all are opened before one is read.
    """
    while True:
        found: list[tuple[Path, BinaryIO]] = []
        try:
            found.extend((part, part.open("rb")) for part in parts_of(path))
            newest = os.fstat(found[-1][1].fileno())
            if os.path.samestat(newest, path.stat()):
                return found
        except FileNotFoundError:
            if not path.exists():
                raise
        except OSError:
            _close(found)
            raise
        _close(found)


def parts_of(path: Path) -> list[Path]:
    """The names of the files that hold what was written to a path, the oldest first; the path
    itself is last, whether it is there or not."""
    numbers = []
    for part in path.parent.glob(f"{glob.escape(path.name)}.*"):
        tail = part.name.removeprefix(f"{path.name}.")
        if tail.isdecimal():
            numbers.append(int(tail))
    parts = [_part(path, number) for number in sorted(numbers, reverse=True)]
    # A crash amid `rotate` leaves two names of one file.
    return [part for part in parts if not _is_one(part, path)] + [path]


def _is_one(part: Path, path: Path) -> bool:
    try:
        return part.samefile(path)
    except OSError:
        return False


def _close(files: list[tuple[Path, BinaryIO]]) -> None:
    for _, file in files:
        file.close()


def _part(path: Path, number: int) -> Path:
    return path.with_name(f"{path.name}.{number}") if number else path


def _open_locked(path: Path) -> int:
    fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(fd)
        raise
    return fd


def _sync_directory(path: Path) -> None:
    """Makes the file's name durable, not only its contents."""
    directory = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(directory)
    finally:
        os.close(directory)
