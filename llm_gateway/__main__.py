"""The LLM gateway process: `python -m llm_gateway`."""

from __future__ import annotations

import sys
import threading
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

from prometheus_client import CollectorRegistry

from llm_gateway.backends.llamacpp.models import ADAPTER
from llm_gateway.backends.registry import make_backend
from llm_gateway.cache import Cache
from llm_gateway.gateway import Gateway
from llm_gateway.http_endpoint import HttpEndpoint
from llm_gateway.loop import LoopThread
from llm_gateway.metrics import GatewayMetrics
from llm_gateway.settings import GatewaySettings, load_settings
from llm_gateway.wish_reading import TrainedModel
from llm_gateway.wishes.readers import embedded_backend
from llm_gateway.zenoh_endpoint import ZenohEndpoint
from swarm import zenoh_config
from swarm.errors import CoAdaptError, TransportError
from swarm.log import Logger, make_logger
from swarm.loop_watch import Loops, LoopWatch, keep_turning, unwatched
from swarm.metrics import serve_metrics
from swarm.process import leave, stop_on_signals
from swarm.session import Session

CLOSE_S = 3.0
T = TypeVar("T")


def main() -> int:
    """Answers egos and HTTP clients until SIGTERM or SIGINT; wrong settings end it with 1."""
    stop = stop_on_signals()
    try:
        settings = load_settings()
        zenoh_config.check_router(settings.router, "gateway")
        run(settings, stop, LoopWatch(make_logger("llm_gateway", swarm=settings.swarm)).loop)
    except CoAdaptError as error:
        print(f"llm_gateway: {error}", file=sys.stderr)
        return 1
    return 0


def run(settings: GatewaySettings, stop: threading.Event, loops: Loops = unwatched) -> None:
    """Runs one gateway until `stop` is set.

    Raises SettingError for an address that cannot be bound and for what the back end cannot use.
    """
    log = make_logger("llm_gateway", level=settings.log_level, swarm=settings.swarm)
    registry = CollectorRegistry()
    gateway = make_gateway(settings, registry, log)
    trained = _trained(settings)
    server = serve_metrics(registry, settings)
    http = HttpEndpoint(
        gateway,
        settings.llm_http_host,
        settings.llm_http_port,
        settings.llm_http_token,
        registry,
        log,
        names=settings.llm_http_names,
        trained=trained,
    )
    thread = LoopThread()
    session: Session | None = None
    try:
        if not _wait(thread.submit(gateway.start()), stop):
            return
        _wait(thread.submit(http.start()), stop)
        thread.submit(keep_turning(loops("gateway", 0.0)))
        log.info(
            "gateway_up",
            backend=settings.llm_backend,
            model=gateway.model,
            http_port=http.port,
            metrics_port=server.port,
        )
        session = _join(settings, registry, log, stop)
        if session is not None:
            ZenohEndpoint(gateway, thread.loop, trained).open(session)
            log.info("router_reached")
        stop.wait()
    finally:
        # The gateway first: those who wait are told before the endpoints close.
        closings = (gateway.close, http.close, *((trained.close,) if trained else ()))
        for closing in closings:
            with suppress(TimeoutError):
                thread.submit(closing()).result(CLOSE_S)
        if session is not None:
            session.drain(CLOSE_S)
            session.close()
        thread.close()
        server.close()
    log.info("gateway_down")


def make_gateway(settings: GatewaySettings, registry: CollectorRegistry, log: Logger) -> Gateway:
    """The gateway that the settings describe, not started. Raises SettingError."""
    metrics = GatewayMetrics(registry)
    cache = Cache(
        Path(settings.llm_cache) if settings.llm_cache else None,
        metrics,
        log,
        ttl_s=settings.llm_cache_ttl_s,
        entries=settings.llm_cache_entries,
    )
    return Gateway(
        make_backend(settings, log),
        cache,
        metrics,
        log,
        queue=settings.llm_queue,
        per_client=settings.llm_per_client,
        window_ms=settings.window_ms(),
        breaker_failures=settings.llm_breaker_failures,
        breaker_s=settings.llm_breaker_s,
        deadline_max_s=settings.llm_deadline_max_s,
    )


def _trained(settings: GatewaySettings) -> TrainedModel | None:
    """The embedded model with what it has learnt of wishes, where the gateway's is that one. A
    process of its own, which starts with the first wish. Raises SettingError."""
    embedded = settings.llm_backend == "llamacpp" and not settings.llm_model
    if not embedded or not ADAPTER.is_file():
        return None
    return TrainedModel(embedded_backend(settings.llm_threads))


def _wait(work: Future[T], stop: threading.Event) -> bool:
    """Waits for work on the loop; False when the process is to stop first."""
    while not stop.is_set():
        with suppress(TimeoutError):
            work.result(0.1)
            return True
    work.cancel()
    return False


def _join(
    settings: GatewaySettings, registry: CollectorRegistry, log: Logger, stop: threading.Event
) -> Session | None:
    """A session of the swarm, waited for; None when the process is to stop first."""
    try:
        return Session(settings.router, settings.swarm, registry=registry, log=log, stop=stop)
    except TransportError:
        return None


if __name__ == "__main__":
    leave(main())
