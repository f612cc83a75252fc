"""Chance in an answer: how likely tokens are, and drawing them by that, from a seed."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

COLDEST = 1e-3
"""Temperatures below this are taken as 0: hardly any two logits are so near each other."""
_NEGLIGIBLE = 40.0
"""Tokens whose scaled logits are so much below the best have a chance of e^-40."""


class Sampler:
    """Draws the tokens of one answer; equal seeds draw alike from equal logits."""

    def __init__(self, temperature: float, top_p: float = 1.0, seed: int | None = None) -> None:
        """`temperature` above 0. `top_p`: only the likeliest tokens that reach this probability
        together are drawn from. Without a seed nobody can draw the same again."""
        self._temperature = temperature
        self._top_p = top_p
        self._random = np.random.default_rng(None if seed is None else seed % 2**64)

    def draw(self, logits: npt.NDArray[np.float32]) -> int:
        """The index of a logit; those of minus infinity are never drawn."""
        below = logits.astype(np.float64) - float(logits.max())
        # Chosen before the division, in which a small temperature would overflow.
        tokens = np.flatnonzero(below >= -_NEGLIGIBLE * self._temperature)
        tokens = tokens[np.argsort(-below[tokens], kind="stable")]
        reached = np.cumsum(np.exp(below[tokens] / self._temperature))
        count = int(np.searchsorted(reached, self._top_p * reached[-1])) + 1
        reached = reached[:count]
        place = int(np.searchsorted(reached, self._random.random() * reached[-1], side="right"))
        return int(tokens[min(place, len(reached) - 1)])


def probability(logits: npt.NDArray[np.float32], token: int) -> float:
    """Of one token among all, in [0, 1]; those of minus infinity have none."""
    above = logits.astype(np.float64) - float(logits[token])
    return float(1.0 / np.exp(np.minimum(above, 700.0)).sum())
