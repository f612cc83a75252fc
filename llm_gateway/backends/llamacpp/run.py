"""One prompt that the embedded model works on, from its arrival to its answer."""

from __future__ import annotations

import codecs
from dataclasses import dataclass, field

from llm_gateway.backends.llamacpp.constraint import Constraint
from llm_gateway.backends.llamacpp.slots import Slot
from llm_gateway.model import Finish, Prompt, Reply
from swarm.messages import LlmTokens


@dataclass
class Run:
    """`tokens` are the prompt's."""

    ident: int
    prompt: Prompt
    tokens: list[int]
    constraint: Constraint
    slot: Slot | None = None
    reused: int = 0
    read: bool = False
    """Whether the whole prompt is in the context."""
    out: list[int] = field(default_factory=list)
    """The answer so far; its last token is not in the context yet."""
    guide: list[int] = field(default_factory=list)
    """The answer to an earlier prompt that began like this one."""
    text: bytearray = field(default_factory=bytearray)
    """The answer so far; a character may be cut."""
    likely: list[tuple[bytes, float]] = field(default_factory=list)
    """Its pieces with their probabilities, where the prompt asks for them."""

    def __post_init__(self) -> None:
        self._stops = [stop.encode() for stop in self.prompt.stop]
        self._decoder = codecs.getincrementaldecoder("utf-8")("replace")
        self._told = 0

    @property
    def held(self) -> Slot:
        """The slot of a run that is not waiting."""
        assert self.slot is not None
        return self.slot

    def add(self, token: int, piece: bytes) -> Finish | None:
        """Goes on with a token; returns why the answer ends with it, if it does."""
        self.constraint.accept(token)
        self.out.append(token)
        before = len(self.text)
        self.text += piece
        # A sequence may have begun in an earlier token.
        if any(self.text.find(s, max(0, before - len(s) + 1)) >= 0 for s in self._stops):
            return "stop"
        if self.constraint.complete():
            return "stop"
        return "length" if len(self.out) >= self.prompt.max_tokens else None

    def words(self) -> str:
        """What has come since the last call, in whole characters."""
        new, self._told = bytes(self.text[self._told :]), len(self.text)
        return self._decoder.decode(new)

    def reply(self, finish: Finish) -> Reply:
        """The whole answer."""
        used = LlmTokens(prompt=len(self.tokens), reused=self.reused, output=len(self.out))
        likely = tuple((piece.decode(errors="replace"), chance) for piece, chance in self.likely)
        return Reply(self.text.decode(errors="replace"), used, finish, likely)
