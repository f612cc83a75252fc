"""Chooses tokens that follow a grammar."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from llm_gateway.backends.llamacpp.native import Native
from llm_gateway.backends.llamacpp.sampler import Sampler

_NEAR = 6.0
"""Tokens whose logits are so near the best are tried before the whole vocabulary, which takes
milliseconds."""


@dataclass(frozen=True)
class Alphabet:
    """Facts about a vocabulary that every grammar needs."""

    letters: npt.NDArray[np.int32]
    """Tokens of one printable ASCII character each, then one that ends the answer."""
    text: str
    """Those characters."""
    markup: npt.NDArray[np.int32]
    """Tokens that stand for no text and end nothing: never chosen."""
    end: int

    @classmethod
    def of(cls, native: Native) -> Alphabet:
        """Reads the whole vocabulary once."""
        letters: dict[str, int] = {}
        markup, ends = [], []
        for token in range(native.vocabulary_size):
            if native.ends(token):
                ends.append(token)
            elif native.is_control(token):
                markup.append(token)
            else:
                piece = native.piece(token)
                if len(piece) == 1 and 0x20 <= piece[0] < 0x7F:
                    letters.setdefault(chr(piece[0]), token)
        if len(letters) < 95 or not ends:
            raise ValueError("the vocabulary lacks an end, or printable ASCII characters")
        chosen = [*letters.values(), ends[0]]
        return cls(
            np.array(chosen, np.int32), "".join(letters), np.array(markup, np.int64), ends[0]
        )


class Constraint:
    """Where one answer stands in its grammar; without a grammar, any text may come."""

    def __init__(
        self, native: Native, alphabet: Alphabet, grammar: str, sampler: Sampler | None = None
    ) -> None:
        """Without a sampler, the likeliest token is chosen.

        Raises ValueError for a grammar that llama.cpp cannot read.
        """
        self._native = native
        self._alphabet = alphabet
        self._sampler = sampler
        self._grammar: Any = native.grammar(grammar) if grammar else None

    def close(self) -> None:
        """Frees the grammar."""
        if self._grammar is not None:
            self._native.free(self._grammar)
            self._grammar = None

    def choose(self, logits: npt.NDArray[np.float32]) -> int:
        """The next token: the best one, or one that is drawn from all that are legal."""
        if self._sampler is None:
            return self.best(logits)
        logits[self._alphabet.markup] = -np.inf
        if self._grammar is not None:
            logits[~self._legal(np.arange(len(logits), dtype=np.int32))] = -np.inf
            if not np.isfinite(logits).any():
                raise RuntimeError("the grammar allows no token at all")
        return self._sampler.draw(logits)

    def best(self, logits: npt.NDArray[np.float32]) -> int:
        """The legal token with the highest logit; the lowest number of equal ones."""
        logits[self._alphabet.markup] = -np.inf
        top = int(np.argmax(logits))
        if self._grammar is None or self._legal(np.array([top], np.int32))[0]:
            return top
        for tokens in (np.flatnonzero(logits > logits[top] - _NEAR), np.arange(len(logits))):
            ranked = tokens[np.argsort(-logits[tokens], kind="stable")].astype(np.int32)
            legal = self._legal(ranked)
            if legal.any():
                return int(ranked[np.argmax(legal)])
        raise RuntimeError("the grammar allows no token at all")

    def accept(self, token: int) -> None:
        """Moves on by a token that `choose` found legal."""
        if self._grammar is not None and token != self._alphabet.end:
            self._native.accept(self._grammar, token)

    def complete(self) -> bool:
        """Whether nothing but the end may follow: that need not be asked of the model.

        Text that is forced is asked for, token by token: a model goes on worse from tokens that it
        would not have chosen ("1.1.1.1" where it gave a sentence).
        """
        if self._grammar is None:
            return False
        legal = self._legal(self._alphabet.letters)
        return bool(legal[-1]) and not legal[:-1].any()

    def _legal(self, tokens: npt.NDArray[np.int32]) -> npt.NDArray[np.bool_]:
        return self._native.legal(self._grammar, tokens)
