"""New inputs out of old ones by their form: a value of a JSON text is changed."""

from __future__ import annotations

import json
import random
from typing import Any

STRANGE: tuple[Any, ...] = (
    *(
        None,
        True,
        False,
        0,
        -1,
        1,
        2**31,
        2**62,
        2**63 - 1,
        2**64,
        -(2**63),
        0.5,
        -0.0,
        1e308,
        1e-320,
    ),
    *("", "R1", "nan", "inf", "\0", "é", "\n", "b:AAAA", "a" * 300, "../x", "2030-01-01T00:00:00Z"),
    *([], {}, [[]], [None] * 40, {"": None}),
)
"""What decoders stumble over, and what takes other ways through them."""


def changed(data: bytes, start: int, chance: random.Random) -> bytes | None:
    """The input with one value of the JSON from `start` on replaced, doubled or left out; None when
    there is no JSON in it."""
    try:
        tree = json.loads(data[start:])
    except (ValueError, RecursionError):
        return None
    places = list(_places(tree))
    if places:
        _change(*chance.choice(places), chance)
    else:
        tree = chance.choice(STRANGE)
    return data[:start] + json.dumps(tree, ensure_ascii=chance.random() < 0.5).encode(
        errors="surrogatepass"
    )


def _places(tree: Any) -> list[tuple[Any, Any]]:
    """(what holds it, its key or index) of every value; no deeper than a parser goes."""
    found, waiting = [], [tree]
    while waiting:
        holder = waiting.pop()
        if isinstance(holder, dict | list):
            keys = list(holder) if isinstance(holder, dict) else range(len(holder))
            found += [(holder, key) for key in keys]
            waiting += [holder[key] for key in keys]
    return found


def _change(holder: Any, key: Any, chance: random.Random) -> None:
    match chance.randrange(4):
        case 0:
            del holder[key]
        case 1 if isinstance(holder, list):
            holder.insert(key, holder[key])
        case 1:
            holder[f"{key}{chance.choice(('', ' ', 'x'))}"] = holder[key]
        case 2 if isinstance(holder[key], int | float) and not isinstance(holder[key], bool):
            holder[key] = chance.choice((-1, 2, 0.5, 10)) * holder[key]
        case _:
            holder[key] = chance.choice(STRANGE)
