"""The HTTP side: routes, bodies, errors, the token, and the correlator."""

from __future__ import annotations

import re
import uuid
from collections.abc import Awaitable, Callable, Mapping

import msgspec
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from network_controller.qod import problems
from network_controller.qod.messages import read
from network_controller.qod.metrics import QodMetrics
from network_controller.qod.openapi import API, CORRELATOR, document
from network_controller.qod.operations import OPERATIONS
from network_controller.qod.problems import ErrorInfo, Problem
from network_controller.qod.service import Service
from swarm.errors import NetworkError
from swarm.http.access import Access
from swarm.http.openapi import OPENAPI_PATH, Operation
from swarm.http.serving import media_type
from swarm.log import Logger

MAX_BODY_BYTES = 65_536
_CORRELATOR = re.compile(CORRELATOR.strip("^$"))
_OPEN_PATHS = API.open_paths
_CODES = {404: "NOT_FOUND", 405: "METHOD_NOT_ALLOWED"}


def make_app(service: Service, access: Access, metrics: QodMetrics, log: Logger) -> ASGIApp:
    """The application, for those whom `access` lets in."""
    described = msgspec.json.encode(document(token=access.needs_token))

    async def openapi(request: Request) -> Response:
        return Response(described, media_type="application/json")

    async def refused(request: Request, error: Exception) -> Response:
        assert isinstance(error, Problem)
        return _error(error.info)

    async def unavailable(request: Request, error: Exception) -> Response:
        return _error(problems.unavailable(str(error)).info)

    async def not_routed(request: Request, error: Exception) -> Response:
        assert isinstance(error, HTTPException)
        code = _CODES.get(error.status_code, "INVALID_ARGUMENT")
        message = f"{request.method} {request.url.path}: {error.detail}"
        info = ErrorInfo(status=error.status_code, code=code, message=message)
        return _error(info, error.headers)

    async def broken(request: Request, error: Exception) -> Response:
        return _error(
            ErrorInfo(status=500, code="INTERNAL", message="the controller's log says what failed")
        )

    app = Starlette(
        routes=[*_routes(service), Route(OPENAPI_PATH, openapi, methods=["GET"])],
        exception_handlers={
            Problem: refused,
            NetworkError: unavailable,
            HTTPException: not_routed,
            Exception: broken,
        },
    )
    app.router.redirect_slashes = False
    return _Gate(app, access, metrics, log)


def _routes(service: Service) -> list[Route]:
    """One route a path: a method that a path does not have is answered with all that it has."""
    by_path: dict[str, dict[str, Callable[[Request], Awaitable[Response]]]] = {}
    for operation in OPERATIONS:
        by_path.setdefault(operation.path, {})[operation.method] = _endpoint(operation, service)

    def route(path: str, answers: Mapping[str, Callable[[Request], Awaitable[Response]]]) -> Route:
        async def answer(request: Request) -> Response:
            return await answers["GET" if request.method == "HEAD" else request.method](request)

        return Route(path, answer, methods=list(answers))

    return [route(path, answers) for path, answers in by_path.items()]


def _endpoint(operation: Operation, service: Service) -> Callable[[Request], Awaitable[Response]]:
    carry_out = service.operations[operation.name]

    async def answer(request: Request) -> Response:
        body = None
        if operation.body is not None:
            raw = await _read(request)
            if not raw:
                raise problems.invalid("the body is missing")
            # Also keeps web pages out: a browser does not send JSON elsewhere without asking first.
            if media_type(request.headers) != "application/json":
                raise problems.unsupported_media(request.headers.get("content-type", ""))
            try:
                body = read(raw, operation.body)
            except msgspec.DecodeError as error:
                raise problems.invalid(f"the body is not valid: {error}") from error
        # The network may wait for the kernel; other requests must not.
        result = await run_in_threadpool(carry_out, request.path_params, body)
        if operation.answer is None:
            return Response(status_code=operation.status)
        raw = msgspec.json.encode(result)
        return Response(raw, operation.status, media_type="application/json")

    return answer


async def _read(request: Request) -> bytes:
    raw = bytearray()
    async for chunk in request.stream():
        raw += chunk
        if len(raw) > MAX_BODY_BYTES:
            raise problems.invalid(f"the body is longer than {MAX_BODY_BYTES} bytes")
    return bytes(raw)


def _error(info: ErrorInfo, headers: Mapping[str, str] | None = None) -> Response:
    return Response(msgspec.json.encode(info), info.status, headers, "application/json")


class _Gate:
    """Around everything: checks the name that was asked for and the token, echoes the correlator,
    counts, and logs failures."""

    def __init__(self, app: ASGIApp, access: Access, metrics: QodMetrics, log: Logger) -> None:
        self._app = app
        self._access = access
        self._metrics = metrics
        self._log = log

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        headers = Headers(scope=scope)
        correlator = headers.get("x-correlator", "")
        sound = _CORRELATOR.fullmatch(correlator) is not None

        async def marked(message: Message) -> None:
            if message["type"] == "http.response.start":
                marks = MutableHeaders(scope=message)
                marks["x-correlator"] = correlator if correlator and sound else str(uuid.uuid4())
                self._metrics.request(scope["method"], message["status"])
            await send(message)

        try:
            wrong = self._access.refusal(headers, without_token=scope["path"] in _OPEN_PATHS)
            if wrong == "token":
                refusal = _error(problems.unauthenticated().info, {"www-authenticate": "Bearer"})
                await refusal(scope, receive, marked)
            elif wrong == "name":
                await _error(problems.another_name().info)(scope, receive, marked)
            elif not sound:
                info = problems.invalid(f"x-correlator must match {_CORRELATOR.pattern}").info
                await _error(info)(scope, receive, marked)
            else:
                await self._app(scope, receive, marked)
        except ClientDisconnect:
            self._log.debug("qod_client_left", path=scope["path"])
        except Exception:
            self._log.error(
                "qod_request_failed", method=scope["method"], path=scope["path"], exc_info=True
            )
