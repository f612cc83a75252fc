"""Answers several prompts at a time with one model: continuous batching with prefix reuse.

Each `step` is one decode of the model: of the newest tokens of every answer under way, or of a
chunk of a prompt. The two take turns, so that answers go on while prompts are read; in one decode
they would be split again, because sequences do not share a cache. Prompts are read one after the
other, so that each finds in the context what it shares with those before it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from llm_gateway.backends.llamacpp import slots as places
from llm_gateway.backends.llamacpp.constraint import Alphabet, Constraint
from llm_gateway.backends.llamacpp.native import CHUNK, Native, Part
from llm_gateway.backends.llamacpp.run import Run
from llm_gateway.backends.llamacpp.sampler import COLDEST, Sampler, probability
from llm_gateway.backends.llamacpp.schema import grammar_of
from llm_gateway.backends.llamacpp.slots import Slot
from llm_gateway.model import Finish, Prompt, Reply
from swarm.errors import GatewayError

Outcome = Reply | GatewayError


@dataclass(frozen=True)
class Tuning:
    """What trades the time of one answer for that of the others."""

    chunk: int = CHUNK
    """Tokens of one decode."""
    draft: int = 12
    """Tokens of an earlier answer that are tried as the next ones in one decode; 0: none."""
    few: int = 2
    """With more answers than this under way nothing is drafted: sequences of different lengths
    would be decoded apart."""
    gap: int = 3
    """So many idle sequences between two busy ones get a token that nobody reads: sequences that
    are no neighbours would be decoded apart, too."""


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
        self._waiting: deque[Run] = deque()
        self._running: list[Run] = []
        self._taken = 0
        self._read_next = False
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
            constraint = Constraint(self._native, self._alphabet, grammar, _sampler(prompt))
        except ValueError as error:
            raise GatewayError("invalid", f"the schema cannot be followed: {error}") from error
        self._waiting.append(Run(ident, prompt, tokens, constraint))

    def cancel(self, ident: int) -> None:
        """Stops the work on a prompt; what was read of it stays for later ones."""
        for run in [*self._waiting, *self._running]:
            if run.ident == ident:
                self._end(run)

    def words(self, ident: int) -> str:
        """What the answer under way to a prompt has got since this was asked last."""
        return next((run.words() for run in self._running if run.ident == ident), "")

    def step(self) -> list[tuple[int, Outcome]]:
        """Asks the model once; returns the answers that are complete now, and a GatewayError
        `failed` for each prompt of which no answer can be made: the others go on."""
        self._begin_reading()
        answering = [run for run in self._running if run.read]
        reading = [run for run in self._running if not run.read]
        self._read_next = bool(reading) and not (answering and self._read_next)
        if self._read_next:
            return self._read(reading[0])
        return self._answer(answering) if answering else []

    def _read(self, run: Run) -> list[tuple[int, Outcome]]:
        """Reads the next chunk of a prompt, and begins its answer when that was the last."""
        slot = run.held
        at = len(slot.tokens)
        chunk = run.tokens[at : at + self._tuning.chunk]
        run.read = at + len(chunk) == len(run.tokens)
        index = self._decode([(slot.number, at, chunk, int(run.read))])[slot.number]
        slot.tokens += chunk
        outcome = self._advance(run, [], index) if run.read else None
        return [] if outcome is None else [(run.ident, outcome)]

    def _answer(self, runs: list[Run]) -> list[tuple[int, Outcome]]:
        """Goes on with all answers under way."""
        runs = sorted(runs, key=lambda run: run.held.number)
        few = len(runs) <= self._tuning.few
        drafts = [self._draft(run) if few else [] for run in runs]
        parts: list[Part] = [
            (run.held.number, len(run.held.tokens), [run.out[-1], *draft], 1 + len(draft))
            for run, draft in zip(runs, drafts, strict=True)
        ]
        fillers = self._fillers([run.held.number for run in runs])
        first = self._decode(sorted([*parts, *fillers]))
        for number, at, _, _ in fillers:
            self._native.keep(number, at)
        done: list[tuple[int, Outcome]] = []
        for run, draft in zip(runs, drafts, strict=True):
            run.held.tokens.append(run.out[-1])
            outcome = self._advance(run, draft, first[run.held.number])
            if outcome is not None:
                done.append((run.ident, outcome))
        return done

    def _fillers(self, numbers: list[int]) -> list[Part]:
        """A token for each idle sequence in a small gap between busy ones."""
        found: list[Part] = []
        for left, right in pairwise(numbers):
            if right - left <= self._tuning.gap + 1:
                between = self._slots[left + 1 : right]
                found += [(s.number, len(s.tokens), [self._alphabet.end], 0) for s in between]
        return found

    def _draft(self, run: Run) -> list[int]:
        """How an earlier answer went on, if it began like this one."""
        done = len(run.out)
        # Chance would hardly follow a draft.
        if not _greedy(run.prompt) or run.guide[:done] != run.out:
            return []
        return run.guide[done : done + self._tuning.draft]

    def _decode(self, parts: list[Part]) -> dict[int, int]:
        """Where the logits of each sequence begin, by its number."""
        self.decodes += 1
        first = self._native.decode(parts)
        return {part[0]: index for part, index in zip(parts, first, strict=True)}

    def _begin_reading(self) -> None:
        """Gives the prompt at the head of the queue a place, once the one before it is read."""
        if not self._waiting or any(not run.read for run in self._running):
            return
        choice = places.choose(self._slots, self._waiting[0].tokens)
        if choice is None:
            return
        run, slot = self._waiting.popleft(), choice.target
        run.guide = choice.source.answer
        if choice.source is not slot:
            if choice.shared:
                self._native.copy(choice.source.number, slot.number)
            slot.answer = []
        self._native.keep(slot.number, choice.shared)
        slot.tokens = run.tokens[: choice.shared]
        self._taken += 1
        slot.busy, slot.used = True, self._taken
        run.slot, run.reused = slot, choice.shared
        self._running.append(run)

    def _advance(self, run: Run, draft: Sequence[int], index: int) -> Outcome | None:
        """What becomes of a run when its next tokens are chosen; None: it goes on."""
        slot = run.held
        try:
            finish = self._choose(run, draft, index)
        except Exception as error:  # What it says concerns this prompt alone, whatever it is.
            self._native.keep(slot.number, len(slot.tokens))
            self._end(run)
            why = f"no token could be chosen: {type(error).__name__}: {error}"
            return GatewayError("failed", why)
        if finish is None:
            return None
        slot.answer = run.out
        self._end(run)
        return run.reply(finish)

    def _choose(self, run: Run, draft: Sequence[int], index: int) -> Finish | None:
        """Takes the model's choices for what was decoded, along a draft while it agrees."""
        agreed = 0
        finish: Finish | None = None
        while finish is None:
            logits = self._native.logits(index + agreed)
            token = run.constraint.choose(logits)
            ended = self._native.ends(token)
            piece = self._native.piece(token)
            if run.prompt.certainty and not ended:
                run.likely.append((piece, probability(logits, token)))
            finish = "stop" if ended else run.add(token, piece)
            if draft[agreed : agreed + 1] != [token]:
                break
            agreed += 1
        slot = run.held
        slot.tokens += draft[:agreed]
        if agreed < len(draft):
            self._native.keep(slot.number, len(slot.tokens))
        return finish

    def _end(self, run: Run) -> None:
        """Gives back what a run holds."""
        run.constraint.close()
        if run.slot is not None:
            run.slot.busy = False
            self._running.remove(run)
        else:
            self._waiting.remove(run)


def _greedy(prompt: Prompt) -> bool:
    """Whether a prompt leaves nothing to chance."""
    return prompt.temperature < COLDEST


def _sampler(prompt: Prompt) -> Sampler | None:
    """What draws a prompt's tokens; None: the likeliest are taken."""
    if _greedy(prompt):
        return None
    return Sampler(prompt.temperature, prompt.top_p, prompt.seed)
