"""The swarm's recordings: which there are, and each as a file to take away."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from starlette.exceptions import HTTPException
from starlette.responses import FileResponse

SUFFIX = ".mcap"
MAX_SHOWN = 100


class Recordings:
    """The files of one folder, which may not be there yet; an empty name stands for none."""

    def __init__(self, folder: str) -> None:
        self._folder = Path(folder) if folder else None

    def found(self) -> list[dict[str, Any]]:
        """Name, bytes and time of the last change (seconds since the epoch), newest first."""
        if self._folder is None:
            return []
        found: list[dict[str, Any]] = []
        for path in self._folder.glob(f"*{SUFFIX}"):
            try:
                facts = path.stat()
            except OSError:  # Taken away meanwhile.
                continue
            found.append({"name": path.name, "bytes": facts.st_size, "at": facts.st_mtime})
        return sorted(found, key=lambda one: one["at"], reverse=True)[:MAX_SHOWN]

    def file(self, name: str) -> FileResponse:
        """One of them, to be saved. Raises HTTPException 404 for a name that is none of theirs."""
        if self._folder is None or name not in {one["name"] for one in self.found()}:
            raise HTTPException(404)
        return FileResponse(
            self._folder / name, media_type="application/octet-stream", filename=name
        )
