"""The HTTP endpoint's application: routes, the token, bodies and clients that go away."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncGenerator, Awaitable
from typing import Any, TypeVar

import msgspec
from prometheus_client import CollectorRegistry, Counter
from starlette.applications import Starlette
from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from llm_gateway.http_chat import Asked, read_request, unknown_model, write_answer
from llm_gateway.http_errors import STATUSES, HttpError, of_gateway
from llm_gateway.http_stream import AnswerStream
from llm_gateway.http_wishes import PATH, read_wish, write_wish
from llm_gateway.model import Completer
from llm_gateway.schemas import Schemas
from llm_gateway.wish_reading import TrainedModel, WishReading
from swarm.errors import GatewayError
from swarm.http.access import Access
from swarm.http.events import EventStream
from swarm.http.serving import media_type
from swarm.log import Logger
from swarm.metrics import start_at_zero

ANOTHER_NAME = (
    "this gateway answers under this host's own addresses, as localhost, and under the names that "
    "COADAPT_LLM_HTTP_NAMES lists"
)
MAX_BODY_BYTES = 2_000_000
DRAINED_BYTES = 16_000_000
"""How much of a longer body is read and thrown away, so that its sender sees the refusal."""
BODY_S = 20.0
HEALTH_PATH = "/healthz"
T = TypeVar("T")


def make_app(
    gateway: Completer,
    access: Access,
    registry: CollectorRegistry,
    log: Logger,
    trained: TrainedModel | None = None,
) -> ASGIApp:
    """The application, for those whom `access` lets in; `trained` understands wishes."""
    began = int(time.time())
    schemas = Schemas()

    async def complete(request: Request) -> Response:
        # Also keeps web pages out: a browser does not send JSON elsewhere without asking first.
        if media_type(request.headers) != "application/json":
            raise HttpError(415, "the body must be application/json")
        raw = await _read(request)
        address = request.client.host if request.client else "local"
        asked = read_request(raw, request.headers, address, gateway.model)
        job = asked.job
        _check(schemas, job.prompt.schema)
        if asked.stream:
            return await _streamed(request, gateway, asked)
        completion = await _unless_gone(request, gateway.complete(job))
        return Response(write_answer(completion), media_type="application/json")

    async def wish(request: Request) -> Response:
        if media_type(request.headers) != "application/json":
            raise HttpError(415, "the body must be application/json")
        asked = read_wish(await _read(request))
        reading = WishReading(gateway, asyncio.get_running_loop(), trained)
        # On a thread of its own: it waits for the model, which this loop works for.
        return write_wish(await _unless_gone(request, asyncio.to_thread(reading.answer, asked)))

    def described() -> dict[str, Any]:
        return {"id": gateway.model, "object": "model", "created": began, "owned_by": "coadapt"}

    async def models(request: Request) -> Response:
        raw = msgspec.json.encode({"object": "list", "data": [described()]})
        return Response(raw, media_type="application/json")

    async def model(request: Request) -> Response:
        if (name := request.path_params["name"]) != gateway.model:
            raise unknown_model(name, gateway.model)
        return Response(msgspec.json.encode(described()), media_type="application/json")

    async def health(request: Request) -> Response:
        return Response(b'{"status":"ok"}', media_type="application/json")

    async def refused(request: Request, error: Exception) -> Response:
        assert isinstance(error, HttpError)
        return error.response()

    async def unanswered(request: Request, error: Exception) -> Response:
        assert isinstance(error, GatewayError)
        return of_gateway(error).response()

    async def not_routed(request: Request, error: Exception) -> Response:
        assert isinstance(error, HTTPException)
        message = f"{request.method} {request.url.path[:200]}: {error.detail}"
        return HttpError(error.status_code, message, headers=error.headers).response()

    async def left(request: Request, error: Exception) -> Response:
        # Nobody reads it; it is counted.
        return Response(status_code=499)

    async def broken(request: Request, error: Exception) -> Response:
        return HttpError(500, "the gateway's log says what failed").response()

    app = Starlette(
        routes=[
            Route("/v1/chat/completions", complete, methods=["POST"]),
            Route(PATH, wish, methods=["POST"]),
            Route("/v1/models", models, methods=["GET"]),
            # Names of models have slashes in them.
            Route("/v1/models/{name:path}", model, methods=["GET"]),
            Route(HEALTH_PATH, health, methods=["GET"]),
        ],
        exception_handlers={
            HttpError: refused,
            GatewayError: unanswered,
            HTTPException: not_routed,
            ClientDisconnect: left,
            Exception: broken,
        },
    )
    app.router.redirect_slashes = False
    return _Gate(app, access, registry, log)


def _check(schemas: Schemas, schema: str) -> None:
    """Tells a client's mistake (400) from a model's (502); the gateway calls both `invalid`."""
    try:
        if schema:
            schemas.check(schema)
    except GatewayError as error:
        raise HttpError(400, str(error), code=error.code, param="response_format") from error


async def _read(request: Request) -> bytes:
    raw = bytearray()
    size = 0
    try:
        async with asyncio.timeout(BODY_S):
            async for chunk in request.stream():
                size += len(chunk)
                if size <= MAX_BODY_BYTES:
                    raw += chunk
                elif size > DRAINED_BYTES:
                    break
    except TimeoutError:
        raise HttpError(408, f"the body did not arrive within {BODY_S:.0f} s") from None
    if size > MAX_BODY_BYTES:
        raise HttpError(413, f"the body has more than {MAX_BODY_BYTES} bytes", code="too_large")
    return bytes(raw)


async def _streamed(request: Request, gateway: Completer, asked: Asked) -> Response:
    """The answer as server-sent events; until its first words there may still be an error."""
    stream = AnswerStream(
        lambda hear: gateway.complete(asked.job, hear),
        gateway.model,
        include_usage=asked.include_usage,
    )
    try:
        await _unless_gone(request, stream.begin())
    except BaseException:
        await stream.close()
        raise

    async def events() -> AsyncGenerator[bytes]:
        try:
            async for event in stream.events():
                yield event
        finally:
            await stream.close()

    headers = {"Cache-Control": "no-cache", "X-Accel-Buffering": "no"}
    return EventStream(events(), headers)


async def _unless_gone(request: Request, awaited: Awaitable[T]) -> T:
    """The result, unless the client goes away first: then the work is cancelled.

    Raises ClientDisconnect.
    """
    work = asyncio.ensure_future(awaited)
    # The body is read: what comes now is that the client has gone.
    gone = asyncio.ensure_future(request.receive())
    try:
        await asyncio.wait({work, gone}, return_when=asyncio.FIRST_COMPLETED)
        if not work.done():
            raise ClientDisconnect
        return work.result()
    finally:
        work.cancel()
        gone.cancel()
        await asyncio.gather(work, gone, return_exceptions=True)


class _Gate:
    """Around everything: checks the name that was asked for and the token, counts, and logs what
    fails."""

    def __init__(
        self, app: ASGIApp, access: Access, registry: CollectorRegistry, log: Logger
    ) -> None:
        self._app = app
        self._access = access
        self._log = log
        self._requests = Counter(
            "coadapt_llm_http_requests_total",
            "Requests at the HTTP endpoint by status; 499 where the client left first.",
            ["status"],
            registry=registry,
        )
        start_at_zero(self._requests, ("200", "499", *map(str, set(STATUSES.values()))))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def counted(message: Message) -> None:
            if message["type"] == "http.response.start":
                self._requests.labels(message["status"]).inc()
            await send(message)

        try:
            await (self._refusal(scope) or self._app)(scope, receive, counted)
        except Exception:
            path = scope["path"][:200]
            self._log.error("llm_http_failed", method=scope["method"], path=path, exc_info=True)

    def _refusal(self, scope: Scope) -> Response | None:
        open_path = scope["path"] == HEALTH_PATH
        match self._access.refusal(Headers(scope=scope), without_token=open_path):
            case "name":
                return HttpError(403, ANOTHER_NAME, code="host").response()
            case "token":
                return HttpError(
                    401,
                    "this needs the header Authorization: Bearer and the gateway's token",
                    code="invalid_api_key",
                    headers={"WWW-Authenticate": "Bearer"},
                ).response()
        return None
