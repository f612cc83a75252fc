"""The HTTP endpoint on an event loop of its own, and a client of it."""

from __future__ import annotations

import asyncio
import http.client
import json
import queue
import threading
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Collection, Generator
from contextlib import asynccontextmanager, closing, contextmanager
from typing import Any, NamedTuple

from prometheus_client import CollectorRegistry

from llm_gateway.backends.openai import OpenAi
from llm_gateway.cache import Cache
from llm_gateway.gateway import Gateway
from llm_gateway.http_endpoint import HttpEndpoint
from llm_gateway.metrics import GatewayMetrics
from llm_gateway.model import Completer, Completion, Hear, Job
from swarm.log import make_logger
from swarm.messages import LlmTimings, LlmTokens
from tests.support.model_server import ModelServer

LOG = make_logger("test", level="critical")
CHAT = "/v1/chat/completions"
HELLO = [{"role": "user", "content": "Hello."}]


class Answer(NamedTuple):
    status: int
    headers: dict[str, str]
    body: Any

    @property
    def text(self) -> str:
        assert self.status == 200, self.body
        return str(self.body["choices"][0]["message"]["content"])

    @property
    def error(self) -> dict[str, Any]:
        """OpenAI's error object, which has these four fields."""
        error: dict[str, Any] = self.body["error"]
        assert set(error) == {"message", "type", "param", "code"}
        return error


class Scripted:
    """A gateway that does what a test says."""

    model = "test-model"

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        self.jobs: queue.Queue[tuple[Job, float]] = queue.Queue()
        """With the time, `time.monotonic()`."""
        self.cancelled: queue.Queue[Job] = queue.Queue()
        self.answer: Callable[[Job], Awaitable[Completion]] = self.echo

    async def complete(self, job: Job, hear: Hear | None = None) -> Completion:
        self.jobs.put((job, time.monotonic()))
        try:
            return await self.answer(job)
        except asyncio.CancelledError:
            self.cancelled.put(job)
            raise

    async def echo(self, job: Job) -> Completion:
        return Completion(
            text=job.prompt.messages[-1].content,
            source="cache",
            hit="exact",
            model=self.model,
            age_s=2.5,
            tokens=LlmTokens(prompt=30, reused=20, output=4),
            timings=LlmTimings(queue_ms=1.0, model_ms=2.0, total_ms=3.0),
        )


class Client:
    """Talks to an endpoint."""

    def __init__(self, port: int, registry: CollectorRegistry) -> None:
        self.port = port
        self.registry = registry

    def send(
        self,
        method: str,
        path: str,
        raw: bytes | None = None,
        headers: dict[str, str] | None = None,
    ) -> Answer:
        sent = {"Content-Type": "application/json"} | (headers or {})
        with closing(http.client.HTTPConnection("127.0.0.1", self.port, timeout=20)) as to:
            to.request(method, path, raw, sent)
            response = to.getresponse()
            names = {name.lower(): value for name, value in response.getheaders()}
            return Answer(response.status, names, json.loads(response.read()))

    def chat(self, *, headers: dict[str, str] | None = None, **fields: Any) -> Answer:
        body = {"messages": HELLO} | fields
        return self.send("POST", CHAT, json.dumps(body).encode(), headers)

    def count(self, name: str, **labels: str) -> float:
        return self.registry.get_sample_value(name, labels) or 0.0


@contextmanager
def running(endpoint: Callable[[], AsyncIterator[Client]]) -> Generator[Client]:
    """An asynchronous context on the event loop of a thread."""
    ready: queue.Queue[Client | BaseException] = queue.Queue()
    loop = asyncio.new_event_loop()
    end = asyncio.Event()

    async def serve() -> None:
        async with asynccontextmanager(endpoint)() as client:
            ready.put(client)
            await end.wait()

    def run() -> None:
        try:
            with asyncio.Runner(loop_factory=lambda: loop) as runner:
                runner.run(serve())
        except BaseException as error:
            ready.put(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    client = ready.get(timeout=20)
    if isinstance(client, BaseException):
        raise client
    try:
        yield client
    finally:
        loop.call_soon_threadsafe(end.set)
        thread.join(20)
        assert ready.empty(), ready.get()


@contextmanager
def endpoint_of(
    gateway: Completer, token: str = "", names: Collection[str] = ()
) -> Generator[Client]:
    """An endpoint on a free port."""

    async def serve() -> AsyncIterator[Client]:
        registry = CollectorRegistry()
        endpoint = HttpEndpoint(gateway, "127.0.0.1", 0, token, registry, LOG, names=names)
        await endpoint.start()
        try:
            yield Client(endpoint.port, registry)
        finally:
            await endpoint.close()

    with running(serve) as client:
        yield client


@contextmanager
def gateway_of(server: ModelServer, **options: Any) -> Generator[Client]:
    """The whole way: the endpoint, the core, the back end `openai` and a server."""

    async def serve() -> AsyncIterator[Client]:
        registry = CollectorRegistry()
        metrics = GatewayMetrics(registry)
        backend = OpenAi(server.url, "test-model", "", 4, LOG)
        gateway = Gateway(backend, Cache(None, metrics, LOG), metrics, LOG, **options)
        await gateway.start()
        endpoint = HttpEndpoint(gateway, "127.0.0.1", 0, "", registry, LOG)
        await endpoint.start()
        try:
            yield Client(endpoint.port, registry)
        finally:
            await endpoint.close()
            await gateway.close()

    with running(serve) as client:
        yield client
