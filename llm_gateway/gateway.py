"""The core of the gateway: from the cache, from a call under way, or from the model; in time.

Everything happens on one event loop, so that nothing needs a lock.
"""

from __future__ import annotations

import asyncio
import time
from dataclasses import replace
from typing import Literal

from llm_gateway.answers import AnswerError, extract
from llm_gateway.backends.base import Backend
from llm_gateway.breaker import Breaker
from llm_gateway.cache import Cache
from llm_gateway.cache_store import Entry
from llm_gateway.dispatch import Dispatcher
from llm_gateway.metrics import GatewayMetrics
from llm_gateway.model import Completion, Hear, Job, Prompt
from llm_gateway.schemas import Schemas
from llm_gateway.single_flight import Flight, Landed
from llm_gateway.waiting import Waiting
from swarm.errors import GatewayError
from swarm.log import Logger
from swarm.messages import MAX_PROMPT_CHARS, LlmTimings, LlmTokens


class Gateway:
    """Answers jobs of all endpoints with one back end."""

    def __init__(
        self,
        backend: Backend,
        cache: Cache,
        metrics: GatewayMetrics,
        log: Logger,
        *,
        queue: int = 128,
        per_client: int = 8,
        window_ms: float = 10.0,
        breaker_failures: int = 5,
        breaker_s: float = 10.0,
        deadline_max_s: float = 120.0,
    ) -> None:
        """At most `queue` model calls wait, `per_client` of them of one client; the first ones
        after a rest wait `window_ms` for each other. Nobody waits longer than `deadline_max_s`.
        """
        self._backend = backend
        self._cache = cache
        self._metrics = metrics
        self._schemas = Schemas()
        self._dispatcher = Dispatcher(
            backend,
            self._schemas,
            Waiting(queue, per_client),
            Breaker(breaker_failures, breaker_s),
            metrics,
            log,
            window_s=window_ms * 1e-3,
            on_landed=self._keep,
        )
        self._deadline_max_s = deadline_max_s

    @property
    def model(self) -> str:
        """The model that answers."""
        return self._backend.model

    @property
    def trouble(self) -> str:
        """Why the model does not answer; empty where it does, or nobody knows."""
        return self._dispatcher.trouble

    async def start(self) -> None:
        """Opens the cache and starts the back end. Raises SettingError."""
        await self._cache.start()
        await self._backend.start()

    async def close(self) -> None:
        """Ends everything; waiting and running jobs fail with `unavailable`."""
        await self._dispatcher.close()
        await self._backend.close()
        await self._cache.close()

    async def complete(self, job: Job, hear: Hear | None = None) -> Completion:
        """An answer to a job before its deadline. Cancelling leaves the job.

        `hear` is told the beginning of the answer while the model is at it, where the back end
        can tell and no schema must be followed first.

        Raises GatewayError, for any of its reasons.
        """
        begun = time.monotonic()
        asked_model = False
        try:
            self._check(job.prompt)
            job = replace(job, deadline=min(job.deadline, begun + self._deadline_max_s))
            key = job.prompt.key(self.model, job.role)
            done = self._known(job, key, begun) if job.prompt.repeatable else None
            if done is None:
                self._metrics.misses.inc()
                asked_model = True
                done = await self._asked(job, key, begun, hear)
        except GatewayError as error:
            self._metrics.refused(error.code, asked_model=asked_model)
            raise
        self._metrics.answered(done)
        return done

    def _check(self, prompt: Prompt) -> None:
        chars = sum(len(message.content) for message in prompt.messages) + len(prompt.schema)
        if chars > MAX_PROMPT_CHARS:
            raise GatewayError(
                "too_large", f"the prompt has {chars} characters; allowed: {MAX_PROMPT_CHARS}"
            )
        if prompt.schema:
            self._schemas.check(prompt.schema)

    def _known(self, job: Job, key: str, begun: float) -> Completion | None:
        """The answer to an equal prompt, else one for an equal scene.

        Either must follow this very prompt's schema: the scene's quantities are rounded, and the
        file of the cache may have been damaged.
        """
        exact = self._cache.exact(key)
        entry = exact
        hit: Literal["exact", "fingerprint"] = "exact"
        if exact is None and job.fingerprint and job.prompt.schema and job.prompt.plain:
            scene = self._cache.scene(self.model, job.role, job.prompt.template, job.fingerprint)
            entry, hit = self._cache.similar(scene), "fingerprint"
        if entry is None or not self._follows(entry, job.prompt):
            return None
        if time.monotonic() > job.deadline:
            raise GatewayError("expired", "the deadline had passed")
        return Completion(
            text=entry.text,
            source="cache",
            hit=hit,
            model=entry.model,
            age_s=self._cache.age_s(entry),
            tokens=LlmTokens(),
            timings=LlmTimings(total_ms=(time.monotonic() - begun) * 1e3),
        )

    def _follows(self, entry: Entry, prompt: Prompt) -> bool:
        """Whether a stored answer follows a prompt's schema."""
        if not prompt.schema:
            return True
        try:
            return extract(entry.text, prompt.schema, self._schemas) == entry.text
        except (AnswerError, GatewayError):
            return False

    async def _asked(self, job: Job, key: str, begun: float, hear: Hear | None) -> Completion:
        """The model's answer, perhaps to another one's equal prompt."""
        if time.monotonic() >= job.deadline:
            raise GatewayError("expired", "the deadline had passed")
        flight = self._dispatcher.flight(key)
        if flight is not None:
            self._metrics.joined.inc()
        else:
            flight = self._dispatcher.submit(job, key, self.model)
        flight.join(job.deadline, hear)
        try:
            await asyncio.wait({flight.future}, timeout=job.deadline - time.monotonic())
            answered = flight.future.done()
        finally:
            self._dispatcher.leave(flight, hear)
        now = time.monotonic()
        if not answered or now > job.deadline:
            where = "in the queue" if flight.started is None else "from the model"
            raise GatewayError("expired", f"no answer after {now - begun:.3f} s {where}")
        landed = flight.future.result()
        started = begun if flight.started is None else max(begun, flight.started)
        return Completion(
            text=landed.text,
            source="llm",
            hit="",
            model=flight.model,
            age_s=0.0,
            tokens=landed.tokens,
            timings=LlmTimings(
                queue_ms=(started - begun) * 1e3,
                model_ms=max(0.0, landed.finished - started) * 1e3,
                total_ms=(now - begun) * 1e3,
            ),
            finish=landed.finish,
        )

    def _keep(self, flight: Flight, landed: Landed) -> None:
        # The cache does not remember why an answer ended.
        if not flight.prompt.repeatable or landed.finish != "stop":
            return
        fingerprint = flight.fingerprint if flight.prompt.plain else ""
        scene = self._cache.scene(flight.model, flight.role, flight.prompt.template, fingerprint)
        self._cache.put(flight.key, scene, flight.model, landed.text, landed.tokens)
