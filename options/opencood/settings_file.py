"""An OpenCOOD `config.yaml` as plain values, with nothing in it ever executed.

OpenCOOD's trainer dumps NumPy arrays that it derived from the other settings into the file, as
YAML tags that name Python functions. Those become inert `Opaque` values; any other Python tag is
refused.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from swarm.errors import PerceptionError

MAX_BYTES = 1_000_000
_PYTHON = "tag:yaml.org,2002:python/"


@dataclass(frozen=True, slots=True)
class Opaque:
    """Where the file asks for a Python object, which is never made."""

    tag: str


class _Loader(yaml.SafeLoader):  # type: ignore[misc]
    """YAML without Python objects; numbers like `1e-4` are strings until somebody reads them."""


def _python_tag(loader: _Loader, suffix: str, node: yaml.Node) -> Any:
    if suffix == "tuple":
        return loader.construct_sequence(node, deep=True)
    kind, _, name = suffix.partition(":")
    if kind in {"name", "object/apply", "object/new"} and name.startswith("numpy."):
        return Opaque(suffix)
    raise yaml.constructor.ConstructorError(
        None, None, f"the tag !!python/{suffix} asks to run Python code", node.start_mark
    )


_Loader.add_multi_constructor(_PYTHON, _python_tag)


def read_settings(path: Path) -> dict[str, Any]:
    """The file's top-level mapping.

    Raises PerceptionError when it cannot be read, is no YAML mapping, or asks for Python code.
    """
    try:
        if path.stat().st_size > MAX_BYTES:
            raise PerceptionError(f"{path} has more than {MAX_BYTES} bytes: it is no config.yaml")
        settings = yaml.load(path.read_text(encoding="utf-8"), Loader=_Loader)
    except (OSError, UnicodeDecodeError) as error:
        raise PerceptionError(f"OpenCOOD configuration {path} cannot be read: {error}") from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise PerceptionError(f"OpenCOOD configuration {path} is refused: {error}") from error
    if not isinstance(settings, dict):
        raise PerceptionError(f"OpenCOOD configuration {path} is no mapping of settings")
    return settings


@dataclass(frozen=True, slots=True)
class Section:
    """A mapping of the file with its dotted name, for errors that say where to look."""

    values: dict[str, Any]
    name: str = ""

    def path(self, key: str) -> str:
        """The dotted name of a key of this section."""
        return f"{self.name}.{key}" if self.name else key

    def wrong(self, key: str, allowed: str) -> PerceptionError:
        """The error for a key whose value is missing or not allowed."""
        value = self.values.get(key, "missing")
        shown = f"!!python/{value.tag}" if isinstance(value, Opaque) else repr(value)[:80]
        return PerceptionError(
            f"OpenCOOD configuration: {self.path(key)} is {shown}; allowed: {allowed}"
        )

    def section(self, key: str) -> Section:
        """The mapping under a key."""
        value = self.values.get(key)
        if not isinstance(value, dict):
            raise self.wrong(key, "a mapping")
        return Section(value, self.path(key))

    def choice(self, key: str, *allowed: object) -> Any:
        """A value that must be one of those allowed."""
        value = self.values.get(key)
        if not any(type(value) is type(one) and value == one for one in allowed):
            raise self.wrong(key, ", ".join(map(str, allowed)))
        return value

    def numbers(self, key: str, count: int | None, low: float, high: float) -> tuple[float, ...]:
        """A list of numbers between `low` and `high`; any positive number of them without count."""
        value = self.values.get(key)
        allowed = f"{count or 'some'} numbers from {low:g} to {high:g}"
        if not isinstance(value, list) or not 1 <= len(value) <= (count or 16):
            raise self.wrong(key, allowed)
        try:
            found = tuple(float(one) for one in value if not isinstance(one, bool))
        except (TypeError, ValueError):
            raise self.wrong(key, allowed) from None
        if len(found) != (count or len(value)) or not all(low <= one <= high for one in found):
            raise self.wrong(key, allowed)
        return found

    def number(self, key: str, low: float, high: float) -> float:
        """A number between `low` and `high`."""
        value = self.values.get(key)
        try:
            found = float("nan" if value is None or isinstance(value, bool) else value)
        except (TypeError, ValueError):
            found = float("nan")
        if not low <= found <= high:
            raise self.wrong(key, f"a number from {low:g} to {high:g}")
        return found

    def whole(self, key: str, low: int, high: int) -> int:
        """A whole number between `low` and `high`."""
        found = self.number(key, low, high)
        if found != int(found):
            raise self.wrong(key, f"a whole number from {low} to {high}")
        return int(found)

    def wholes(self, key: str, count: int | None, low: int, high: int) -> tuple[int, ...]:
        """A list of whole numbers between `low` and `high`."""
        found = self.numbers(key, count, low, high)
        if any(one != int(one) for one in found):
            raise self.wrong(key, f"whole numbers from {low} to {high}")
        return tuple(int(one) for one in found)
