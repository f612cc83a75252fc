"""Statistics of the residuals: counted by the encoder, sent as two small factors.

How likely a return is depends on how many neighbours have one; how large its residual is depends
on the expected magnitude. Only these two sets of weights are sent; the tables of the entropy coder
are their products. A weight is one byte, two to the factor of two; all arithmetic is on integers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perception.codec.interlace import MAGNITUDES, PASSES, SURROUNDINGS
from perception.codec.rans import TOTAL, Tables
from perception.codec.residuals import SYMBOLS

FIRST = PASSES * MAGNITUDES * SURROUNDINGS
"""Context of the cells of the first columns."""
_CONTEXTS = np.arange(FIRST + 1)
_MAGNITUDE_ROW = _CONTEXTS // SURROUNDINGS
_PRESENCE_ROW = np.where(
    _CONTEXTS == FIRST,
    PASSES * SURROUNDINGS,
    _CONTEXTS // (SURROUNDINGS * MAGNITUDES) * SURROUNDINGS + _CONTEXTS % SURROUNDINGS,
)
_ROWS = int(_MAGNITUDE_ROW[-1]) + 1
_PRESENCE_ROWS = PASSES * SURROUNDINGS + 1
_MIN_PRESENT = 40
"""Slots kept for returns even where none is expected: every used symbol needs one."""
MAX_WEIGHTS = 2 * _PRESENCE_ROWS + _ROWS * (SYMBOLS - 1)
_WEIGHTS = np.concatenate([[0], np.rint(16 * 2 ** (np.arange(255) / 2).clip(0, 24))]).astype(
    np.int64
)


def count(contexts: NDArray[np.int32], symbols: NDArray[np.uint8]) -> bytes:
    """The weights that describe these symbols, one byte each."""
    used = int(symbols.max(initial=0)) + 1
    joint = np.bincount(contexts * used + symbols, minlength=(FIRST + 1) * used)
    joint = joint.reshape(-1, used)
    passes = joint[:FIRST].reshape(PASSES, MAGNITUDES, SURROUNDINGS, used)
    by_magnitude = np.concatenate([passes.sum(axis=2).reshape(-1, used), joint[FIRST:]])
    around = np.concatenate([passes.sum(axis=1).reshape(-1, used), joint[FIRST:]])
    presence = np.stack([around[:, 0], around[:, 1:].sum(axis=1)], axis=1)
    return _weigh(presence).tobytes() + _weigh(by_magnitude[:, 1:]).T.tobytes()


def from_weights(weights: bytes) -> Tables:
    """The tables for the weights; any bytes give valid tables (missing ones count as zero)."""
    split = 2 * _PRESENCE_ROWS
    used = min(max((len(weights) - split) // _ROWS, 1), SYMBOLS - 1)
    octets = np.zeros(split + used * _ROWS, dtype=np.uint8)
    given = np.frombuffer(weights, np.uint8)[: len(octets)]
    octets[: len(given)] = given
    presence = _WEIGHTS[octets[:split]].reshape(-1, 2)
    sizes = _WEIGHTS[octets[split:]].reshape(used, _ROWS).T.copy()
    sizes[:, 0] += sizes.sum(axis=1) == 0
    places = (sizes > 0).sum(axis=1)[_MAGNITUDE_ROW]
    absent = presence[:, 0] * TOTAL // np.maximum(presence.sum(axis=1), 1)
    absent = np.clip(absent[_PRESENCE_ROW], 1, TOTAL - np.maximum(_MIN_PRESENT, places))
    rest = TOTAL - absent
    sizes = sizes[_MAGNITUDE_ROW]
    share = sizes * (rest - places)[:, None] // sizes.sum(axis=1, keepdims=True)
    table = np.concatenate([absent[:, None], np.where(sizes > 0, share + 1, 0)], axis=1)
    most = sizes.argmax(axis=1) + 1
    table[_CONTEXTS, most] += TOTAL - table.sum(axis=1)
    return Tables(table.astype(np.uint32))


def _weigh(counts: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Counts as logarithmic weights; zero stays zero."""
    logs = np.rint(2 * np.log2(np.maximum(counts, 1))) + 1
    return np.where(counts > 0, logs, 0).astype(np.uint8)
