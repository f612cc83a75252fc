"""The swarm's recordings: which there are, and each as a file to take away."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from starlette.exceptions import HTTPException
from starlette.responses import StreamingResponse

MAX_SHOWN = 100
CHUNK_BYTES = 256 * 1024
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,200}\.mcap")


class Recordings:
    """The files of one folder, which may not be there yet; an empty name stands for none."""

    def __init__(self, folder: str) -> None:
        self._folder = Path(folder) if folder else None

    def found(self) -> list[dict[str, Any]]:
        """Name, bytes and time of the last change (seconds since the epoch), newest first."""
        if self._folder is None:
            return []
        found: list[dict[str, Any]] = []
        for path in self._folder.glob("*.mcap"):
            try:
                facts = path.stat()
            except OSError:  # Taken away meanwhile.
                continue
            if _NAME.fullmatch(path.name):
                found.append({"name": path.name, "bytes": facts.st_size, "at": facts.st_mtime})
        return sorted(found, key=lambda one: one["at"], reverse=True)[:MAX_SHOWN]

    def file(self, name: str) -> StreamingResponse:
        """One of them, to be saved: as much as there is now of one that is being written.

        Raises HTTPException 404 for a name that is none of theirs.
        """
        sizes = {one["name"]: one["bytes"] for one in self.found()}
        if self._folder is None or name not in sizes:
            raise HTTPException(404)
        return StreamingResponse(
            _beginning(self._folder / name, sizes[name]),
            media_type="application/octet-stream",
            headers={
                "Content-Disposition": f'attachment; filename="{name}"',
                "Content-Length": str(sizes[name]),
            },
        )


def _beginning(path: Path, size: int) -> Iterator[bytes]:
    with path.open("rb") as file:
        while size > 0 and (chunk := file.read(min(CHUNK_BYTES, size))):
            size -= len(chunk)
            yield chunk
