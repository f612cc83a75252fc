"""From the queue to the model: batches, places, retries and the circuit breaker."""

from __future__ import annotations

import asyncio
import functools
import random
import time
import traceback
from collections.abc import Callable

from llm_gateway.answers import AnswerError, extract
from llm_gateway.backends.base import Backend
from llm_gateway.breaker import Breaker
from llm_gateway.budget import RetryBudget
from llm_gateway.metrics import GatewayMetrics
from llm_gateway.model import Finish, Hear, Job, PromptRefusedError, Reply
from llm_gateway.schemas import Schemas
from llm_gateway.single_flight import Flight, Landed
from llm_gateway.stops import Telling, before_stop
from llm_gateway.waiting import Waiting
from swarm.errors import GatewayError
from swarm.log import Logger

MAX_TRIES = 3
BACKOFF_S = 0.1
"""Before the first retry, twice as long before the next; half of it is chance."""
HANG_S = 1.0
"""A call that its clients gave up sooner says nothing of the model."""
CLOSE_S = 1.0
CLOCK_S = 0.01
"""A timer may fire this much early."""
_RETRIED = ("failed", "unavailable", "invalid", "expired")


class Dispatcher:
    """Keeps the model busy with the jobs whose turn it is. Used on one event loop."""

    def __init__(
        self,
        backend: Backend,
        schemas: Schemas,
        waiting: Waiting[Flight],
        breaker: Breaker,
        metrics: GatewayMetrics,
        log: Logger,
        *,
        window_s: float,
        on_landed: Callable[[Flight, Landed], None],
    ) -> None:
        """`on_landed` hears of every answer before those who wait for it."""
        self._backend = backend
        self._schemas = schemas
        self._waiting = waiting
        self._breaker = breaker
        self._budget = RetryBudget(time.monotonic())
        self._metrics = metrics
        self._log = log
        self._window_s = window_s
        self._on_landed = on_landed
        self._window: asyncio.TimerHandle | None = None
        self._flights: dict[str, Flight] = {}
        self._running: set[Flight] = set()
        self._closed = False

    @property
    def trouble(self) -> str:
        """Why the model does not answer; empty where it does, or nobody knows."""
        return self._backend.trouble or self._breaker.trouble

    def flight(self, key: str) -> Flight | None:
        """The call for an equal prompt, waiting or under way."""
        return self._flights.get(key)

    def submit(self, job: Job, key: str, model: str) -> Flight:
        """Queues a call. The caller joins it at once.

        Raises GatewayError `unavailable` while the breaker is open, `busy` without room.
        """
        if self._closed:
            raise GatewayError("unavailable", "the gateway is closing")
        refusal = self._breaker.refusal(time.monotonic())
        if refusal:
            if self._backend.trouble:
                refusal = f"the model does not answer: {self._backend.trouble}"
            raise GatewayError("unavailable", refusal)
        flight = Flight(
            job.prompt,
            key,
            model,
            job.fingerprint,
            job.client,
            job.role,
            job.deadline,
            asyncio.get_running_loop().create_future(),
        )
        full, displaced = self._waiting.refusal(flight)
        if full:
            raise GatewayError("busy", full)
        if displaced is not None:
            self._metrics.displaced.inc()
            self._give_up(displaced, GatewayError("busy", "displaced by a more urgent request"))
        flight.probe = self._breaker.admit()
        self._flights[key] = flight
        self._waiting.put(flight)
        self._show()
        self._wake()
        return flight

    def leave(self, flight: Flight, hear: Hear | None) -> None:
        """One does not wait any more; what nobody waits for is not worked on."""
        flight.leave(hear)
        if flight.waiters or flight.future.done():
            return
        self._give_up(flight, GatewayError("expired", "nobody waits for it any more"))
        self._show()

    async def close(self) -> None:
        """Fails what waits and what is under way with `unavailable`."""
        self._closed = True
        if self._window is not None:
            self._window.cancel()
        closing = GatewayError("unavailable", "the gateway is closing")
        for flight in list(self._flights.values()):
            self._give_up(flight, closing)
        self._show()
        tasks = [flight.task for flight in self._running if flight.task is not None]
        if tasks:
            await asyncio.wait(tasks, timeout=CLOSE_S)

    def _give_up(self, flight: Flight, error: GatewayError) -> None:
        flight.fail(error)
        self._drop(flight)
        if flight.task is not None:
            flight.task.cancel()
        elif flight.probe:
            self._breaker.abandoned()

    def _drop(self, flight: Flight) -> None:
        self._waiting.remove(flight)
        if self._flights.get(flight.key) is flight:
            del self._flights[flight.key]

    def _wake(self) -> None:
        """Starts what there is a place for; the first jobs after a rest wait for each other."""
        if self._window is not None:
            if len(self._waiting) < self._backend.parallel:
                return
        elif not self._running and self._window_s and len(self._waiting) < self._backend.parallel:
            self._window = asyncio.get_running_loop().call_later(self._window_s, self._fill)
            return
        self._fill()

    def _fill(self) -> None:
        if self._window is not None:
            self._window.cancel()
            self._window = None
        started = 0
        while self._waiting and len(self._running) < self._backend.parallel:
            flight = self._waiting.pop()
            flight.started = time.monotonic()
            self._running.add(flight)
            flight.task = asyncio.create_task(self._run(flight))
            flight.task.add_done_callback(functools.partial(self._ended, flight))
            started += 1
        if started:
            self._metrics.batch.observe(started)
        self._show()

    async def _run(self, flight: Flight) -> None:
        try:
            landed = await self._tried(flight)
        except GatewayError as error:
            flight.fail(error)
        else:
            self._on_landed(flight, landed)
            flight.land(landed)

    def _ended(self, flight: Flight, task: asyncio.Task[None]) -> None:
        # A callback, because a task that is cancelled before it began runs no line of its own.
        self._running.discard(flight)
        self._drop(flight)
        if task.cancelled():
            self._judge_given_up(flight)
        elif (error := task.exception()) is not None:
            self._log.error("dispatch_fault", exc_info=error)
            flight.fail(GatewayError("failed", f"internal error: {type(error).__name__}"))
        self._fill()

    async def _tried(self, flight: Flight) -> Landed:
        """Calls the model, again where that may help and can be afforded."""
        self._budget.called()
        for attempt in range(MAX_TRIES):
            try:
                landed = await self._call(flight)
            except GatewayError as error:
                self._judge(flight, error)
                pause_s = BACKOFF_S * 2**attempt * random.uniform(0.5, 1.0)
                now = time.monotonic()
                if (
                    error.code not in _RETRIED
                    or isinstance(error, PromptRefusedError)
                    # Another answer would not go on from these words.
                    or flight.told
                    or attempt + 1 == MAX_TRIES
                    or self._breaker.state != "closed"
                    or now + pause_s >= flight.deadline
                    or not self._budget.take(now)
                ):
                    raise
                self._metrics.retries.inc()
                await asyncio.sleep(pause_s)
            else:
                self._succeeded()
                return landed
        raise AssertionError("the last try returns or raises")

    async def _call(self, flight: Flight) -> Landed:
        self._metrics.calls.inc()
        prompt = flight.prompt
        reply = await self._asked(flight, flight.deadline - time.monotonic())
        self._metrics.used(reply.tokens)
        # Here once more: not every server knows stop sequences.
        text, stopped = before_stop(reply.text, prompt.stop)
        finish: Finish = "stop" if stopped else reply.finish
        if prompt.schema:
            try:
                text = extract(text, prompt.schema, self._schemas)
            except AnswerError as error:
                self._metrics.invalid.labels(error.reason).inc()
                cut = f" (cut at max_tokens = {prompt.max_tokens})" if finish == "length" else ""
                raise GatewayError("invalid", f"the model's answer{cut}: {error}") from error
            finish = "stop"
        return Landed(text, reply.tokens, time.monotonic(), finish)

    async def _asked(self, flight: Flight, timeout_s: float) -> Reply:
        telling = Telling(flight.prompt.stop)

        def hear(words: str) -> None:
            if told := telling.take(words):
                flight.tell(told)

        # What must follow a schema is told when it does.
        listened = flight.listeners and not flight.prompt.schema
        try:
            return await self._backend.complete(
                flight.prompt, timeout_s, hear if listened else None
            )
        except GatewayError:
            raise
        except Exception as error:
            # A fault of the back end's own. Its words may hold what is not for logs.
            where = traceback.extract_tb(error.__traceback__)[-1]
            name = type(error).__name__
            self._log.error("backend_fault", error=name, at=f"{where.filename}:{where.lineno}")
            raise GatewayError("failed", f"the back end raised {name}") from error

    def _judge(self, flight: Flight, error: GatewayError) -> None:
        """Tells the breaker how a call ended."""
        self._metrics.faults.labels(error.code).inc()
        if error.code == "invalid" or isinstance(error, PromptRefusedError):
            self._succeeded()
        elif error.code == "expired":
            self._judge_expired(flight, str(error))
        elif error.code != "too_large":
            self._failed(flight, str(error))
        elif flight.probe:
            # Says nothing of the model's health.
            self._breaker.abandoned()

    def _judge_given_up(self, flight: Flight) -> None:
        """A model that did not answer in time may hang; one whose client left early need not."""
        now = time.monotonic()
        if now >= flight.deadline - CLOCK_S:
            self._metrics.faults.labels("expired").inc()
            self._judge_expired(flight, "expired: no answer in time")
        elif flight.probe:
            self._breaker.abandoned()

    def _judge_expired(self, flight: Flight, why: str) -> None:
        ran_s = time.monotonic() - flight.started if flight.started is not None else 0.0
        if flight.probe or ran_s >= HANG_S:
            self._failed(flight, f"{why} ({ran_s:.1f} s)")

    def _succeeded(self) -> None:
        if self._breaker.trouble:
            self._log.info("breaker_closed")
        self._breaker.succeeded()

    def _failed(self, flight: Flight, why: str) -> None:
        if not self._breaker.failed(time.monotonic(), why[:200], probe=flight.probe):
            return
        if not flight.probe:
            self._log.warning("breaker_open", error=why[:200])
        for waiting in self._waiting.clear():
            self._give_up(waiting, GatewayError("unavailable", f"the breaker opened: {why[:200]}"))

    def _show(self) -> None:
        self._metrics.queue.set(len(self._waiting))
        self._metrics.running.set(len(self._running))
        self._metrics.show_breaker(self._breaker.state)
