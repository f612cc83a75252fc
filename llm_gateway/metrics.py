"""What Prometheus reads of the gateway."""

from __future__ import annotations

from typing import get_args

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram

from llm_gateway.answers import Reason
from llm_gateway.breaker import State
from llm_gateway.model import Completion
from swarm.errors import GatewayCode
from swarm.messages import LlmTokens
from swarm.metrics import start_at_zero

_SECONDS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100)
_STATES: dict[State, int] = {"closed": 0, "half_open": 1, "open": 2}
_HITS = ("exact", "fingerprint")
_TOKENS = ("prompt", "reused", "output")
_CACHE_FAULTS = ("slow", "read", "write", "dropped", "corrupt")


class GatewayMetrics:
    """Labels are bounded: sources, codes and kinds; no clients, models or words."""

    def __init__(self, registry: CollectorRegistry) -> None:
        def counter(name: str, text: str, *labels: str) -> Counter:
            return Counter(f"coadapt_llm_{name}", text, labels, registry=registry)

        def gauge(name: str, text: str) -> Gauge:
            return Gauge(f"coadapt_llm_{name}", text, registry=registry)

        def histogram(name: str, text: str, buckets: tuple[float, ...], *labels: str) -> Histogram:
            return Histogram(
                f"coadapt_llm_{name}", text, labels, buckets=buckets, registry=registry
            )

        self.requests = counter(
            "requests_total",
            "Requests by source (llm, exact, fingerprint; none) and outcome (ok or a code).",
            "source",
            "outcome",
        )
        self.refusals = counter("refusals_total", "Requests without an answer, by code.", "code")
        self.joined = counter("joined_total", "Requests that shared another one's model call.")
        self.displaced = counter("displaced_total", "Waiting jobs that made room for others.")
        self.queue = gauge("queue_depth", "Jobs that wait for the model.")
        self.running = gauge("in_flight", "Jobs that the model works on.")
        self.batch = histogram(
            "batch_size", "Jobs that were given to the model together.", (1, 2, 4, 8, 16, 32, 64)
        )
        self.latency = histogram(
            "latency_seconds",
            "Time of an answer by stage: queue, model, total; hit is the total of a cache hit.",
            _SECONDS,
            "stage",
        )
        self.tokens = counter("tokens_total", "Tokens: prompt, reused of it, output.", "kind")
        self.calls = counter("model_calls_total", "Calls of the model, retries included.")
        self.retries = counter("retries_total", "Calls that were made again.")
        self.faults = counter("model_faults_total", "Calls without an answer, by code.", "code")
        self.invalid = counter("invalid_answers_total", "Answers not usable, by reason.", "reason")
        self.hits = counter("cache_hits_total", "Answers from the cache, by kind.", "kind")
        self.misses = counter("cache_misses_total", "Requests that the cache cannot answer.")
        self.cache_faults = counter(
            "cache_faults_total", "What the cache's disk refused, by kind.", "kind"
        )
        self.breaker = gauge("breaker_state", "0 closed, 1 half open, 2 open.")
        codes = get_args(GatewayCode)
        start_at_zero(self.requests, ("llm", *_HITS), ("ok",))
        start_at_zero(self.requests, ("llm", "none"), codes)
        start_at_zero(self.refusals, codes)
        start_at_zero(self.latency, ("queue", "model", "total", "hit"))
        start_at_zero(self.tokens, _TOKENS)
        start_at_zero(self.faults, codes)
        start_at_zero(self.invalid, get_args(Reason))
        start_at_zero(self.hits, _HITS)
        start_at_zero(self.cache_faults, _CACHE_FAULTS)

    def answered(self, done: Completion) -> None:
        """Counts a request that got its answer."""
        self.requests.labels(done.hit or "llm", "ok").inc()
        if done.hit:
            self.hits.labels(done.hit).inc()
            self.latency.labels("hit").observe(done.timings.total_ms * 1e-3)
            return
        self.latency.labels("queue").observe(done.timings.queue_ms * 1e-3)
        self.latency.labels("model").observe(done.timings.model_ms * 1e-3)
        self.latency.labels("total").observe(done.timings.total_ms * 1e-3)

    def refused(self, code: str, *, asked_model: bool) -> None:
        """Counts a request that got none."""
        self.requests.labels("llm" if asked_model else "none", code).inc()
        self.refusals.labels(code).inc()

    def used(self, tokens: LlmTokens) -> None:
        """Counts what one call read and wrote."""
        for kind in _TOKENS:
            self.tokens.labels(kind).inc(getattr(tokens, kind))

    def show_breaker(self, state: State) -> None:
        """Takes the breaker's state."""
        self.breaker.set(_STATES[state])
