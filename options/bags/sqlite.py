"""rosbag2's sqlite3 storage (`.db3`)."""

from __future__ import annotations

import sqlite3
import threading
import weakref
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote

from options.bags.storage import Index, Place, make_index
from options.bags.unpack import MAX_UNPACKED_BYTES
from swarm.errors import WorldError

_DAMAGED = (sqlite3.Error, MemoryError)
"""What a damaged file may raise: SQLite runs out of memory over some headers."""


class SqliteFile:
    """One `.db3` file. What lies beyond a cut is left out."""

    def __init__(self, path: Path) -> None:
        """Opens a file. Raises WorldError for one that is no bag, or has nothing to read."""
        self.path = path
        self.cut = ""
        self._lock = threading.Lock()
        self._rows: dict[int, list[tuple[int, int, int]]] = {}
        try:
            self._connection = _open(path)
            weakref.finalize(self, self._connection.close)
            self._check_whole()
            topics = self._connection.execute(
                "SELECT id, name, type, serialization_format FROM topics"
            ).fetchall()
        except _DAMAGED as error:
            why = str(error) or repr(error)
            code = getattr(error, "sqlite_errorcode", None)
            if code == sqlite3.SQLITE_CANTOPEN and _has_journal(path):
                why += (
                    "; what its recorder left in the journal beside it (-wal) can only be read in "
                    "a folder that can be written: copy both into one"
                )
            raise WorldError(f"bag file {path} cannot be read: {why}") from error
        for row in self._messages():
            self._rows.setdefault(row[0], []).append((row[2], row[1], 0))
        if self.cut:
            self._drop_unreadable()
        self._ids: dict[str, list[int]] = {}
        self.topics: dict[str, str] = {}
        for identity, name, kind, encoding in topics:
            if self._rows.get(identity) and encoding == "cdr":
                self._ids.setdefault(name, []).append(identity)
                self.topics[name] = kind

    def index(self, topic: str) -> Index:
        """See `Storage`."""
        return make_index([row for identity in self._ids[topic] for row in self._rows[identity]])

    def read(self, place: Place, most: int | None = None) -> bytes:
        """See `Storage`."""
        try:
            # A blob is opened, not selected: selecting would read all of it for its first bytes.
            with (
                self._lock,
                self._connection.blobopen("messages", "data", place[0], readonly=True) as blob,
            ):
                size = len(blob) if most is None else min(len(blob), most)
                if size > MAX_UNPACKED_BYTES:
                    raise WorldError(
                        f"message {place[0]} of bag file {self.path} has {size} bytes; allowed: "
                        f"{MAX_UNPACKED_BYTES}"
                    )
                return blob.read(size)
        except _DAMAGED as error:
            raise WorldError(
                f"message {place[0]} of bag file {self.path} cannot be read: {error!r}"
            ) from error

    def _check_whole(self) -> None:
        pages = self._connection.execute("PRAGMA page_count").fetchone()[0]
        page_bytes = self._connection.execute("PRAGMA page_size").fetchone()[0]
        size = self.path.stat().st_size
        # The header's own count: SQLite trusts the file's size where they differ.
        with self.path.open("rb") as file:
            file.seek(28)
            pages = max(pages, int.from_bytes(file.read(4), "big"))
        if size < pages * page_bytes:
            self.cut = f"{pages * page_bytes} bytes were written, {size} are there"

    def _messages(self) -> Iterator[tuple[int, int, int]]:
        """(topic, row, time) of all messages that can be listed."""
        try:
            for row in self._connection.execute("SELECT topic_id, id, timestamp FROM messages"):
                if all(isinstance(value, int) for value in row):
                    yield row
                else:
                    self.cut = self.cut or f"one of its messages is {row!r:.200}"
        except _DAMAGED as error:
            self.cut = self.cut or str(error) or repr(error)

    def _drop_unreadable(self) -> None:
        """Leaves out the last messages, whose bytes lie beyond the cut."""
        for rows in self._rows.values():
            while rows and not self._readable(rows[-1][1]):
                rows.pop()

    def _readable(self, row: int) -> bool:
        try:
            self.read((row, 0))
        except WorldError:
            return False
        return True


def _open(path: Path) -> sqlite3.Connection:
    place = quote(str(path.absolute()))
    # A recorder that was killed leaves a journal beside the file, which only a connection that may
    # look at it takes into account; a folder that cannot be written allows no such connection.
    options = "mode=ro" if _has_journal(path) else "mode=ro&immutable=1"
    connection = sqlite3.connect(f"file:{place}?{options}", uri=True, check_same_thread=False)
    # A database whose end is missing opens only so.
    connection.execute("PRAGMA writable_schema=ON")
    # Of names and types of topics, too: what is longer is refused, not read.
    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_UNPACKED_BYTES)
    return connection


def _has_journal(path: Path) -> bool:
    journal = path.with_name(path.name + "-wal")
    return journal.exists() and journal.stat().st_size > 0
