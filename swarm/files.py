"""Files that are there whole or not at all, however the process that writes them ends."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A path to write to, beside `path`, which it becomes at the end; after an error it is gone,
    and what `path` was remains.

    Threads and processes that write one file do not meet: the last to end wins. Raises OSError.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}-{threading.get_ident()}.part")
    try:
        yield part
        # A name must not outlive a loss of power without what it names.
        with open(part, "rb") as written:
            os.fsync(written.fileno())
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def write_whole(path: Path, content: str | bytes, mode: int | None = None) -> None:
    """Writes a file whole or not at all, and never readable by more than `mode` says.

    Raises OSError.
    """
    with whole_file(path) as part:
        if mode is not None:
            part.touch(mode=mode)
        part.write_bytes(content.encode() if isinstance(content, str) else content)
