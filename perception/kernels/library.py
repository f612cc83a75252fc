"""The compiled loops as ctypes functions.

`pip install` compiles them with the machine's C compiler, once for each instruction set that it
knows (pyproject.toml). Where there is none, `None` stands for a library, and what the loops do is
done in NumPy and PyTorch.
"""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

_FOLDER = Path(__file__).parent
_VERSION = 3
"""Of the libraries' functions: one that was built from another source is not called."""
_NEEDED = {
    "_network_avx512": {"avx512f", "avx2", "fma"},
    "_network_avx2": {"avx2", "fma"},
    "_network_plain": set[str](),
}
"""Builds of network.c, the widest vectors first, with what /proc/cpuinfo must announce."""
_KINDS = {
    "p": ctypes.c_void_p,
    "i": ctypes.c_int,
    "l": ctypes.c_long,
    "f": ctypes.c_float,
    "d": ctypes.c_double,
    "v": None,
}
_NETWORK = {
    "scratch3": "l ii",
    "team_make": "p i",
    "team_end": "v p",
    "convolve3": "v p piiii ppi pii p pi p",
    "scratch": "l iii",
    "convolve": "v p piiii ii ppi pi ii pi ii p",
    "limit": "v ppli",
    "image_scratch": "l iil",
    "attend": "v pp ili p",
    "image": "l pl fffff ii ppp pppp",
}
_CODING = {
    "rans_put": "l ppp ll ppl pl p",
    "rans_take": "l pl ppp l pl pll p",
    "interlace_record": "v pp lll l ppp ppppp",
    "interlace_read": "l lll l ppp ppppp ppp l pl pl pp pl p",
    "residuals_read": "l pl pp pll pp",
    "residuals_write": "l ppl pp",
    "cells_to_points": "v pp ll d pppp p",
}
_PLACES = {
    "heights_above": "v pl ff l f ppl l pp p",
    "find_objects": "v ppl ff ff l l ppp ppp",
    "ray_ends": "l ppl ff l i pp p",
    "gather_cells": "l ppl ff l pp ppppp",
    "stamp": "v pp ll ppl pp l",
    "sum_shifted": "v pl pll l p",
    "sum_moved": "v pl dd pl p pl p",
}
"""Each function's result and arguments, by their kinds."""


@cache
def network() -> ctypes.CDLL | None:
    """network.c for the widest vectors that this processor has; None where it was not compiled."""
    flags = processor_flags()
    for name, needed in _NEEDED.items():
        if needed <= flags:
            found = load(_FOLDER, name, _VERSION, _NETWORK)
            if found is not None:
                return found
    return None


@cache
def coding() -> ctypes.CDLL | None:
    """coding.c; None where it was not compiled."""
    return load(_FOLDER, "_coding", _VERSION, _CODING)


@cache
def places() -> ctypes.CDLL | None:
    """places.c; None where it was not compiled."""
    return load(_FOLDER, "_places", _VERSION, _PLACES)


@cache
def processor_flags() -> frozenset[str]:
    """What /proc/cpuinfo announces of the processor; empty where it cannot be read."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return frozenset()
    words = [line.partition(":")[2].split() for line in lines if line.startswith("flags")]
    return frozenset(words[0]) if words else frozenset()


def pointer(array: NDArray[np.generic] | None) -> int | None:
    """Where an array's first element lies, as functions of these libraries take it."""
    return None if array is None else array.ctypes.data


def load(folder: Path, name: str, version: int, functions: dict[str, str]) -> ctypes.CDLL | None:
    """The library of that name in a folder, if its `loops_version` is this one; else None.

    `functions` gives each function's result and arguments by their kinds: p pointer, i int, l long,
    f float, d double, v none.
    """
    for path in sorted(folder.glob(f"{name}.*so")):
        try:
            library = ctypes.CDLL(str(path))
            if library.loops_version() != version:
                continue
            for function, kinds in functions.items():
                result, *arguments = (_KINDS[kind] for kind in kinds.replace(" ", ""))
                declared = library[function]
                declared.restype = result
                declared.argtypes = arguments  # type: ignore[assignment]
                setattr(library, function, declared)
        except (OSError, AttributeError):
            # Built for another processor or C library, or from a much older source.
            continue
        return library
    return None
