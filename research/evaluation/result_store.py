"""Results of finished pieces of work, a file each, so that an interrupted run goes on."""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import msgspec

from swarm.files import write_whole

SOURCES = (".gguf", ".json", ".py", ".safetensors", ".toml")


class ResultStore:
    """A folder of results; those of other code or weights are not found.

    Results are what MessagePack can hold. A file that cannot be read counts as not there.
    """

    def __init__(self, folder: Path, made_from: Sequence[str]) -> None:
        """`made_from`: the packages and files, relative to the project's root, whose code and
        weights decide what comes out."""
        self._folder = folder / code_digest(tuple(made_from))

    def get(self, key: str) -> Any | None:
        """The result kept under the key; None where there is none."""
        try:
            return msgspec.msgpack.decode(zlib.decompress(self._path(key).read_bytes()))
        except (OSError, zlib.error, msgspec.DecodeError):
            return None

    def put(self, key: str, result: Any) -> None:
        """Keeps a result. It is there whole or not at all, however the process ends."""
        path = self._path(key)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, zlib.compress(msgspec.msgpack.encode(result), 1))

    def _path(self, key: str) -> Path:
        return self._folder / f"{hashlib.sha256(key.encode()).hexdigest()[:24]}.bin"


@cache
def code_digest(made_from: tuple[str, ...]) -> str:
    """A digest of the code and the weights that results come from."""
    root = Path(__file__).parents[2]
    digest = hashlib.sha256()
    for name in made_from:
        start = root / name
        if not start.exists():
            raise FileNotFoundError(f"{start}: results are said to be made from it")
        for path in [start] if start.is_file() else sorted(start.rglob("*")):
            if path.suffix in SOURCES:
                digest.update(str(path.relative_to(root)).encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
