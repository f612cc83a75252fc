"""The swarm's recordings: which there are, and each as a file to take away."""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from starlette.exceptions import HTTPException
from starlette.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from options.console.answers import Recorded

MAX_SHOWN = 100
"""How many are listed; older ones can still be asked for by name."""
CHUNK_BYTES = 256 * 1024
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,200}\.mcap")


class Recordings:
    """The files of one folder, which may not be there yet; an empty name stands for none."""

    def __init__(self, folder: str) -> None:
        self._folder = Path(folder) if folder else None

    def found(self) -> list[Recorded]:
        """The newest first."""
        if self._folder is None:
            return []
        found: list[Recorded] = []
        for path in self._folder.glob("*.mcap"):
            try:
                facts = path.stat()
            except OSError:  # Taken away meanwhile.
                continue
            if _NAME.fullmatch(path.name) and stat.S_ISREG(facts.st_mode):
                found.append(Recorded(name=path.name, bytes=facts.st_size, at=facts.st_mtime))
        return sorted(found, key=lambda one: one.at, reverse=True)[:MAX_SHOWN]

    def file(self, name: str) -> StreamingResponse:
        """One of them, to be saved: as much as there is now of one that is being written.

        Raises HTTPException: 404 for a name that is none of theirs, 403 for one that the console
        may not read.
        """
        if self._folder is None or not _NAME.fullmatch(name):
            raise HTTPException(404)
        try:
            # Not to wait for a pipe's other end, should the name be one's.
            file = os.fdopen(os.open(self._folder / name, os.O_RDONLY | os.O_NONBLOCK), "rb")
        except PermissionError as error:
            raise HTTPException(403, f"the console may not read {name}") from error
        except OSError as error:
            raise HTTPException(404) from error
        facts = os.fstat(file.fileno())
        if not stat.S_ISREG(facts.st_mode):
            file.close()
            raise HTTPException(404)
        return _Download(file, name, facts.st_size)


class _Download(StreamingResponse):
    """The first `size` bytes of an open file, which it closes."""

    def __init__(self, file: BinaryIO, name: str, size: int) -> None:
        super().__init__(
            _beginning(file, size),
            media_type="application/octet-stream",
            headers={
                "Content-Disposition": f'attachment; filename="{name}"',
                "Content-Length": str(size),
            },
        )
        self._file = file

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Ends with the file, or when the client goes away."""
        with self._file:
            await super().__call__(scope, receive, send)


def _beginning(file: BinaryIO, size: int) -> Iterator[bytes]:
    while size > 0 and (chunk := file.read(min(CHUNK_BYTES, size))):
        size -= len(chunk)
        yield chunk
