"""What is fuzzed: a function that takes bytes, and the errors that it may end with."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass

MAX_BYTES = 4096


@dataclass(frozen=True, slots=True)
class Target:
    """One decoder, or some that read the same form."""

    take: Callable[[bytes], None]
    """Reads an input, and checks what came of it."""
    errors: tuple[type[Exception], ...]
    """Those that the docstrings of the decoders name; any other one is a crash."""
    max_bytes: int = MAX_BYTES
    """Of an input."""
    json_from: int | None = None
    """Where the JSON of an input begins; then inputs are also made by changing its values, which a
    decoder in C, whose coverage nobody sees, does not help to guess. None: inputs are no JSON."""


def load(place: str) -> Target:
    """The target that lies at `module:NAME`.

    Raises ImportError and AttributeError when there is none.
    """
    module, _, name = place.partition(":")
    found = getattr(importlib.import_module(module), name)
    if not isinstance(found, Target):
        raise AttributeError(f"{place} is a {type(found).__name__}, not a Target")
    return found


def packages(place: str) -> tuple[str, ...]:
    """What a target's worker measures the coverage of: packages that read bytes of others."""
    return (
        *("ego_agent", "llm_gateway", "mcap", "network_controller", "options", "perception"),
        *("swarm", "worlds", place.partition(":")[0].partition(".")[0]),
    )
