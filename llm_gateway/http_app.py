"""The HTTP endpoint's application: routes, bodies and clients that go away."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncGenerator, Awaitable
from typing import TypeVar

import msgspec
from prometheus_client import CollectorRegistry
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Route
from starlette.types import ASGIApp

from llm_gateway.http_chat import ParsedChat, read_request, unknown_model, write_answer
from llm_gateway.http_errors import HttpError, of_gateway
from llm_gateway.http_gate import Gate
from llm_gateway.http_messages import Model, Models
from llm_gateway.http_operations import API
from llm_gateway.http_stream import AnswerStream
from llm_gateway.http_wishes import read_wish, write_wish
from llm_gateway.model import Completer
from llm_gateway.schemas import Schemas
from llm_gateway.wish_reading import TrainedModel, WishReading
from swarm.errors import GatewayError
from swarm.http.access import Access
from swarm.http.events import EventStream
from swarm.http.openapi import OPENAPI_PATH, Health
from swarm.http.serving import media_type
from swarm.log import Logger

MAX_BODY_BYTES = 2_000_000
DRAINED_BYTES = 16_000_000
"""How much of a longer body is read and thrown away, so that its sender sees the refusal."""
BODY_S = 20.0
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
    document = msgspec.json.encode(API.document(token=access.needs_token))

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
        return _json(write_answer(completion))

    async def wish(request: Request) -> Response:
        if media_type(request.headers) != "application/json":
            raise HttpError(415, "the body must be application/json")
        asked = read_wish(await _read(request))
        reading = WishReading(gateway, asyncio.get_running_loop(), trained)
        # On a thread of its own: it waits for the model, which this loop works for.
        answer = await _unless_gone(request, asyncio.to_thread(reading.answer, asked))
        return _json(write_wish(answer))

    def described() -> Model:
        return Model(id=gateway.model, created=began)

    async def models(request: Request) -> Response:
        return _json(msgspec.json.encode(Models(data=(described(),))))

    async def model(request: Request) -> Response:
        if (name := request.path_params["name"]) != gateway.model:
            raise unknown_model(name, gateway.model)
        return _json(msgspec.json.encode(described()))

    async def health(request: Request) -> Response:
        return _json(msgspec.json.encode(Health()))

    async def openapi(request: Request) -> Response:
        return _json(document)

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

    endpoints = {
        "createChatCompletion": complete,
        "readWish": wish,
        "listModels": models,
        "retrieveModel": model,
        "getHealth": health,
    }
    app = Starlette(
        routes=[
            *(Route(o.path, endpoints[o.name], methods=[o.method]) for o in API.operations),
            Route(OPENAPI_PATH, openapi, methods=["GET"]),
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
    return Gate(app, access, registry, log)


def _json(raw: bytes) -> Response:
    return Response(raw, media_type="application/json")


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


async def _streamed(request: Request, gateway: Completer, asked: ParsedChat) -> Response:
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
