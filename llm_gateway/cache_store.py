"""Answers on disk: one SQLite file, used by one thread."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from swarm.messages import LlmTokens

_TABLE = """
CREATE TABLE IF NOT EXISTS answers_1 (
    key TEXT PRIMARY KEY, scene TEXT NOT NULL, model TEXT NOT NULL, text TEXT NOT NULL,
    made_at REAL NOT NULL, prompt INTEGER NOT NULL, reused INTEGER NOT NULL, output INTEGER NOT NULL
) WITHOUT ROWID;
CREATE INDEX IF NOT EXISTS answers_1_made_at ON answers_1 (made_at);
"""
_FIELDS = "key, scene, model, text, made_at, prompt, reused, output"


@dataclass(frozen=True, slots=True)
class Entry:
    """One answer that followed its prompt's schema."""

    key: str
    """Hash of prompt, model and the role of who asked."""
    scene: str
    """What `Cache.scene` makes of the scene's fingerprint; empty where there was none."""
    model: str
    text: str
    made_at: float
    """Seconds since the epoch."""
    tokens: LlmTokens


class Store:
    """Methods raise sqlite3.Error or OSError for what the disk refuses.

    A file that is no database any more is moved aside as NAME.corrupt, and a new one is begun.
    """

    def __init__(self, path: Path, entries: int) -> None:
        """Opens nothing yet. At most `entries` answers stay; the oldest go first."""
        self.path = path
        self._most = entries
        self._database: sqlite3.Connection | None = None
        self.moved_aside = 0

    def load(self, oldest: float) -> list[Entry]:
        """The answers made since `oldest`, the newest last."""
        with self._opened() as database:
            rows = database.execute(
                f"SELECT {_FIELDS} FROM answers_1 WHERE made_at >= ? ORDER BY made_at DESC LIMIT ?",
                (oldest, self._most),
            ).fetchall()
            return [entry for row in reversed(rows) if (entry := _entry(row)) is not None]

    def put(self, entry: Entry, oldest: float) -> None:
        """Keeps an answer, and forgets those made before `oldest` and those too many."""
        tokens = entry.tokens
        with self._opened() as database, database:
            database.execute(
                f"INSERT OR REPLACE INTO answers_1 ({_FIELDS}) VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
                (
                    *(entry.key, entry.scene, entry.model, entry.text, entry.made_at),
                    *(tokens.prompt, tokens.reused, tokens.output),
                ),
            )
            database.execute("DELETE FROM answers_1 WHERE made_at < ?", (oldest,))
            (count,) = database.execute("SELECT count(*) FROM answers_1").fetchone()
            if count > self._most:
                database.execute(
                    "DELETE FROM answers_1 WHERE key IN "
                    "(SELECT key FROM answers_1 ORDER BY made_at LIMIT ?)",
                    (count - self._most,),
                )

    def _open(self) -> None:
        """Opens the file, and makes it and its directory where they are missing."""
        if self._database is not None:
            return
        self.path.parent.mkdir(parents=True, exist_ok=True)
        try:
            self._database = _connect(self.path)
        except sqlite3.DatabaseError as error:
            if not _is_corrupt(error):
                raise
            self._move_aside()
            self._database = _connect(self.path)

    def close(self) -> None:
        """Closes the file; another call opens it again."""
        if self._database is not None:
            database, self._database = self._database, None
            database.close()

    @contextlib.contextmanager
    def _opened(self) -> Iterator[sqlite3.Connection]:
        self._open()
        assert self._database is not None
        try:
            yield self._database
        except sqlite3.DatabaseError as error:
            if _is_corrupt(error):
                self.close()
                self._move_aside()
            raise

    def _move_aside(self) -> None:
        self.path.replace(self.path.with_name(self.path.name + ".corrupt"))
        for ending in ("-wal", "-shm"):
            self.path.with_name(self.path.name + ending).unlink(missing_ok=True)
        self.moved_aside += 1


def _connect(path: Path) -> sqlite3.Connection:
    database = sqlite3.connect(path, timeout=0.1)
    try:
        database.execute("PRAGMA journal_mode = WAL")
        # An answer that a power cut takes is asked for again.
        database.execute("PRAGMA synchronous = NORMAL")
        database.execute("PRAGMA journal_size_limit = 4000000")
        (found,) = database.execute("PRAGMA quick_check(1)").fetchone()
        if found != "ok":
            damaged = sqlite3.DatabaseError(f"malformed: {found}")
            damaged.sqlite_errorcode = sqlite3.SQLITE_CORRUPT
            raise damaged
        database.executescript(_TABLE)
    except BaseException:
        database.close()
        raise
    return database


def _entry(row: tuple[Any, ...]) -> Entry | None:
    """A row, unless it was damaged: SQLite keeps whatever type stands in a column."""
    names = ("key", "scene", "model", "text", "made_at", "tokens")
    tokens = dict(zip(("prompt", "reused", "output"), row[5:], strict=True))
    try:
        return msgspec.convert(dict(zip(names, (*row[:5], tokens), strict=True)), Entry)
    except msgspec.ValidationError:
        return None


def _is_corrupt(error: sqlite3.DatabaseError) -> bool:
    # The low byte is the kind of an extended code; faults of Python's module have none.
    code = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_OK) & 0xFF
    return code in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)
