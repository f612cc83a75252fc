"""Answers several prompts at a time with one model: continuous batching with prefix reuse.

Each `step` is one decode of the model. It holds the newest tokens of every answer under way, and
a chunk of the prompt that is being read: answers go on while prompts are read. Prompts are read
one after the other, so that each finds in the context what it shares with those before it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

from llm_gateway.backends.llamacpp import slots as places
from llm_gateway.backends.llamacpp.constraint import Alphabet, Constraint
from llm_gateway.backends.llamacpp.native import CHUNK, Native
from llm_gateway.backends.llamacpp.schema import grammar_of
from llm_gateway.backends.llamacpp.slots import Slot
from llm_gateway.model import Prompt, Reply
from swarm.errors import GatewayError
from swarm.messages import LlmTokens


@dataclass(frozen=True)
class Tuning:
    """What trades the time of one answer for that of the others."""

    chunk: int = CHUNK
    """Tokens of one decode."""
    beside: int = 96
    """Of a prompt, read in one decode while answers are under way."""
    draft: int = 12
    """Tokens of the last answer that are tried as the next ones in one decode; 0: none."""
    drafters: int = 2
    """With more answers than this under way, nothing is drafted: batches are full anyway."""
    jump: bool = True
    """Whether text that the grammar forces is appended without asking the model."""


@dataclass
class _Run:
    """One prompt from its arrival to its answer."""

    ident: int
    prompt: list[int]
    limit: int
    constraint: Constraint
    slot: Slot | None = None
    reused: int = 0
    read: bool = False
    """Whether the whole prompt is in the context."""
    out: list[int] = field(default_factory=list)
    pending: list[int] = field(default_factory=list)
    """The end of `out`, which is not in the context yet."""
    guide: list[int] = field(default_factory=list)
    """The answer to the prompt before this one: where drafts come from."""


class Engine:
    """Not for several threads."""

    def __init__(
        self, native: Native, *, sequences: int, context: int, tuning: Tuning | None = None
    ) -> None:
        self._native = native
        self._context = context
        self._tuning = tuning or Tuning()
        self._alphabet = Alphabet.of(native)
        self._slots = [Slot(i) for i in range(sequences)]
        self._waiting: deque[_Run] = deque()
        self._running: list[_Run] = []
        self._taken = 0
        self.decodes = 0
        """How often the model was asked."""

    @property
    def busy(self) -> bool:
        """Whether `step` has something to do."""
        return bool(self._waiting or self._running)

    def submit(self, ident: int, prompt: Prompt) -> None:
        """Queues a prompt. Raises GatewayError `too_large`, or `invalid` for a bad schema."""
        tokens = self._native.chat(prompt.messages)
        if len(tokens) + prompt.max_tokens > self._context:
            raise GatewayError(
                "too_large",
                f"{len(tokens)} tokens of prompt and {prompt.max_tokens} of answer, "
                f"the model's context holds {self._context}",
            )
        try:
            grammar = grammar_of(prompt.schema) if prompt.schema else ""
            constraint = Constraint(self._native, self._alphabet, grammar)
        except ValueError as error:
            raise GatewayError("invalid", f"the schema cannot be followed: {error}") from error
        self._waiting.append(_Run(ident, tokens, prompt.max_tokens, constraint))

    def cancel(self, ident: int) -> None:
        """Stops the work on a prompt; what was read of it stays for later ones."""
        for run in [*self._waiting, *self._running]:
            if run.ident == ident:
                self._end(run)

    def step(self) -> list[tuple[int, Reply]]:
        """Asks the model once; returns the answers that are complete now."""
        self._begin_reading()
        parts, runs = self._parts()
        if not parts:
            return []
        first = self._native.decode(parts)
        self.decodes += 1
        done = []
        for run, (_, _, tokens, answers), index in zip(runs, parts, first, strict=True):
            assert run.slot is not None
            if run.read:
                reply = self._advance(run, tokens[len(tokens) - answers + 1 :], index)
            else:
                run.slot.tokens += tokens
                run.read = len(run.slot.tokens) == len(run.prompt)
                reply = self._advance(run, [], index) if run.read else None
            if reply is not None:
                done.append((run.ident, reply))
        return done

    def _begin_reading(self) -> None:
        """Gives the prompt at the head of the queue a place, once the one before it is read."""
        if not self._waiting or any(not run.read for run in self._running):
            return
        choice = places.choose(self._slots, self._waiting[0].prompt)
        if choice is None:
            return
        run, slot = self._waiting.popleft(), choice.target
        run.guide = choice.source.answer
        if choice.source is not slot:
            if choice.shared:
                self._native.copy(choice.source.number, slot.number)
            slot.answer = []
        self._native.keep(slot.number, choice.shared)
        slot.tokens = run.prompt[: choice.shared]
        self._taken += 1
        slot.busy, slot.used = True, self._taken
        run.slot, run.reused = slot, choice.shared
        self._running.append(run)

    def _parts(self) -> tuple[list[tuple[int, int, list[int], int]], list[_Run]]:
        """What the next decode reads, in the order of the sequences' numbers."""
        answering = [run for run in self._running if run.read]
        room = self._tuning.chunk
        found: list[tuple[int, int, list[int], int, _Run]] = []
        for run in answering:
            assert run.slot is not None
            draft = self._draft(run) if len(answering) <= self._tuning.drafters else []
            tokens = run.pending + draft
            found.append((run.slot.number, len(run.slot.tokens), tokens, 1 + len(draft), run))
            room -= len(tokens)
        if answering:
            room = min(room, self._tuning.beside)
        for run in self._running:
            if not run.read and room > 0:
                assert run.slot is not None
                at = len(run.slot.tokens)
                chunk = run.prompt[at : at + room]
                ends = at + len(chunk) == len(run.prompt)
                found.append((run.slot.number, at, chunk, int(ends), run))
        found.sort(key=lambda part: part[0])
        return [part[:4] for part in found], [part[4] for part in found]

    def _draft(self, run: _Run) -> list[int]:
        """How the last answer goes on, if it began like this one."""
        done = len(run.out)
        if run.guide[:done] != run.out:
            return []
        return run.guide[done : done + self._tuning.draft]

    def _advance(self, run: _Run, draft: Sequence[int], index: int) -> Reply | None:
        """Takes the model's choices for what was read, along a draft while it agrees."""
        slot = run.slot
        assert slot is not None
        slot.tokens += run.pending
        run.pending = []
        agreed = 0
        while not run.pending:
            token = run.constraint.best(self._native.logits(index + agreed))
            if self._native.ends(token):
                return self._finish(run, draft, agreed)
            run.constraint.accept(token)
            new = [token]
            complete = False
            if self._tuning.jump:
                text, complete = run.constraint.forced()
                new += self._native.tokens(text, special=False)
            run.out += new
            if complete or len(run.out) >= run.limit:
                return self._finish(run, draft, agreed)
            same = places.common(new, draft[agreed:])
            agreed += same
            run.pending = new[same:]
        self._drop(slot, draft, agreed)
        return None

    def _drop(self, slot: Slot, draft: Sequence[int], agreed: int) -> None:
        slot.tokens += draft[:agreed]
        if agreed < len(draft):
            self._native.keep(slot.number, len(slot.tokens))

    def _finish(self, run: _Run, draft: Sequence[int], agreed: int) -> Reply:
        assert run.slot is not None
        self._drop(run.slot, draft, agreed)
        run.slot.answer = run.out
        self._end(run)
        text = b"".join(self._native.piece(token) for token in run.out[: run.limit])
        tokens = LlmTokens(prompt=len(run.prompt), reused=run.reused, output=len(run.out))
        return Reply(text.decode(errors="replace"), tokens)

    def _end(self, run: _Run) -> None:
        """Gives back what a run holds."""
        run.constraint.close()
        if run.slot is not None:
            run.slot.busy = False
            self._running.remove(run)
        else:
            self._waiting.remove(run)
