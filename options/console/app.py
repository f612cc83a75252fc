"""The console's pages, its stream, and its controls."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import parse_qs

import msgspec
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.routing import Route

from options.console.answers import Floor, History
from options.console.controls import CONTROLS, Control
from options.console.files import Recordings
from options.console.guard import COOKIE, LOGIN, SIGNED_IN_S, Guard, same_origin
from options.console.hub import Hub
from options.console.metrics import ConsoleMetrics
from options.console.operations import API, CSRF_HEADER
from options.console.past import STEPS_S
from options.console.places import PlaceChange, SitePlaces
from options.console.seats import Seat, Seats
from options.console.watch import Watch
from swarm.controllers import merged
from swarm.errors import (
    CoAdaptError,
    KeyspaceError,
    NetworkError,
    RefusedError,
    SettingError,
    TransportError,
)
from swarm.http.events import EventStream
from swarm.http.hosts import Hosts
from swarm.http.openapi import OPENAPI_PATH
from swarm.http.serving import media_type
from swarm.log import Logger
from swarm.messages import Message, ShapeRequest

PAGE = Path(__file__).parent / "page"
KINDS = {".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
OPERATOR = "console"
WHO = {
    "shape": "the network controller",
    "ego": "the ego",
    "robot": "the robot",
    "wish": "the LLM gateway",
}
MAX_BODY_BYTES = 1_500_000
"""A trace of 100,000 rates fits, also where each is 10 Gbit/s."""
WRONG_TOKEN_S = 1.0
_T = TypeVar("_T")


def make_app(
    seats: Seats,
    floor: Floor,
    hosts: Hosts,
    token: str,
    metrics: ConsoleMetrics,
    log: Logger,
    *,
    recordings: Recordings,
    places: SitePlaces,
) -> Guard:
    """The application; with a token, viewers must show it, as a header or in the login form.

    What is about an ego is about the first one, or the one that the query names (`?ego=R4`).
    """
    pages = {name: (PAGE / name).read_bytes() for name in ("index.html", "login.html")}
    assets = {f.name: f.read_bytes() for f in PAGE.iterdir() if f.suffix in KINDS}
    document = API.document(token=bool(token))
    spans = {str(span_s): span_s for span_s in STEPS_S}

    async def index(request: Request) -> Response:
        return Response(pages["index.html"], media_type="text/html")

    async def asset(request: Request) -> Response:
        name = request.path_params["name"]
        if name not in assets:
            raise HTTPException(404)
        return Response(assets[name], media_type=KINDS[Path(name).suffix])

    async def login(request: Request) -> Response:
        if request.method == "GET":
            return Response(pages["login.html"], media_type="text/html")
        if not same_origin(request.headers):
            return _refused(403, "this form was sent from elsewhere")
        form = await _form(request)
        cookie = guard.sign_in(form)
        if cookie is None:
            log.warning("console_wrong_token")
            await asyncio.sleep(WRONG_TOKEN_S)
            return Response(pages["login.html"], 401, media_type="text/html")
        done = RedirectResponse("/", 303)
        done.set_cookie(COOKIE, cookie, max_age=SIGNED_IN_S, httponly=True, samesite="strict")
        return done

    async def events(request: Request) -> Response:
        seat = _seat(seats, request)
        if seats.full():
            return _refused(503, "too many pages look at this swarm")
        return EventStream(_counted(seat.hub, metrics), stalled=metrics.stalled.inc)

    async def floor_plan(request: Request) -> Response:
        shown = await asyncio.to_thread(places.shown)
        return _json(msgspec.structs.replace(floor, **msgspec.structs.asdict(shown)))

    async def history(request: Request) -> Response:
        span = request.query_params.get("span", "")
        if span not in spans:
            return _refused(400, f"span {span[:20]!r} is none of {', '.join(spans)} s")
        past = _seat(seats, request).past
        if past is None:
            return _refused(404, "the swarm runs without Prometheus")
        try:
            rows = await past.rows(spans[span])
        except TransportError as error:
            return _refused(503, str(error))
        return _json(History(rows=rows))

    async def recorded(request: Request) -> Response:
        return _json(await asyncio.to_thread(recordings.found))

    async def recording(request: Request) -> Response:
        return await asyncio.to_thread(recordings.file, request.path_params["name"])

    async def place(request: Request) -> Response:
        _check_page(request, seats)
        asked = await _asked(request, PlaceChange)
        robots = {robot for seat in seats.taken for robot in seat.view.robots()}
        try:
            shown = await asyncio.to_thread(places.change, asked, robots)
        except SettingError as error:
            metrics.requests.labels("place", "refused").inc()
            return _refused(409, str(error))
        metrics.requests.labels("place", "done").inc()
        log.info("console_place", act=asked.act, place=asked.name, operator=OPERATOR)
        seats.tell_places()
        return _json(shown)

    async def control(request: Request) -> Response:
        _check_page(request, seats)
        seat, what = _seat(seats, request), request.path_params["what"]
        if what not in CONTROLS:
            raise HTTPException(404)
        asked = await _asked(request, CONTROLS[what].request)
        asked = msgspec.structs.replace(asked, operator=OPERATOR)
        robot = request.path_params.get("robot", "")
        try:
            reply = await _answer(seat.watch, CONTROLS[what], asked, robot)
        except RefusedError as error:
            metrics.requests.labels(what, "refused").inc()
            log.info("console_refused", what=what, robot=robot, why=str(error)[:300])
            return _refused(409, error.reason)
        except (KeyspaceError, NetworkError) as error:
            metrics.requests.labels(what, "refused").inc()
            return _refused(400, str(error))
        except CoAdaptError as error:
            # Pages ask every few seconds what is in force: the log is not to fill with it.
            metrics.requests.labels(what, "unanswered").inc()
            log.debug("console_unanswered", what=what, robot=robot, why=str(error)[:300])
            return _refused(504, f"{WHO[what]} does not answer: {error}")
        metrics.requests.labels(what, "done").inc()
        log.debug("console_asked", what=what, robot=robot)
        return _json(reply)

    async def openapi(request: Request) -> Response:
        return _json(document)

    app = Starlette(
        routes=[
            Route("/", index, methods=["GET"]),
            Route("/assets/{name}", asset, methods=["GET"]),
            Route(LOGIN, login, methods=["GET", "POST"]),
            Route("/api/events", events, methods=["GET"]),
            Route("/api/floor", floor_plan, methods=["GET"]),
            Route("/api/history", history, methods=["GET"]),
            Route("/api/recordings", recorded, methods=["GET"]),
            Route("/recordings/{name}", recording, methods=["GET"]),
            Route(OPENAPI_PATH, openapi, methods=["GET"]),
            Route("/api/place", place, methods=["POST"]),
            Route("/api/{what}", control, methods=["POST"]),
            Route("/api/{what}/{robot}", control, methods=["POST"]),
        ],
        exception_handlers={HTTPException: _not_routed, ClientDisconnect: _left},
    )
    app.router.redirect_slashes = False
    guard = Guard(app, hosts, token)
    return guard


def _seat(seats: Seats, request: Request) -> Seat:
    """Of the ego that a request is about. Raises HTTPException for a robot that does not decide."""
    ego = request.query_params.get("ego", "")
    seat = seats.of(ego)
    if seat is None:
        raise HTTPException(404, f"{ego[:32]!r} is no ego; egos are {', '.join(seats.egos)}")
    return seat


async def _counted(hub: Hub, metrics: ConsoleMetrics) -> AsyncGenerator[bytes]:
    """What one viewer is sent, counted once it is."""
    stream = hub.stream()
    try:
        async for event in stream:
            yield event
            metrics.events.inc()
            metrics.sent.inc(len(event))
    finally:
        await stream.aclose()


async def _answer(watch: Watch, control: Control, request: Message, robot: str) -> Message:
    """The reply; of several controllers, theirs as one. Raises what `Watch.ask` does."""
    if not isinstance(request, ShapeRequest):
        reply: Message = (await asyncio.wrap_future(watch.ask(control, request, robot))).message
        return reply
    futures = watch.ask_controllers(request)
    answers = await asyncio.gather(*map(asyncio.wrap_future, futures.values()))
    return merged(dict(zip(futures, (answer.message for answer in answers), strict=True)))


def _check_page(request: Request, seats: Seats) -> None:
    """Raises HTTPException for what does not come from a page that is open now."""
    if not same_origin(request.headers):
        raise HTTPException(403, "controls answer to the console's own page only")
    if not seats.may_control(request.headers.get(CSRF_HEADER, "")):
        raise HTTPException(403, "this page is not connected any more: reload it")
    if media_type(request.headers) != "application/json":
        raise HTTPException(415, "the body must be application/json")


async def _asked(request: Request, kind: type[_T]) -> _T:
    """What is asked for. Raises HTTPException for a body that is not of that kind."""
    body = await _read(request)
    try:
        return msgspec.json.decode(body, type=kind)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise HTTPException(400, f"the request is not valid: {error}") from error


def _json(value: Any) -> Response:
    return Response(msgspec.json.encode(value), media_type="application/json")


def _refused(status: int, why: str) -> JSONResponse:
    return JSONResponse({"error": why}, status)


async def _read(request: Request) -> bytes:
    raw = bytearray()
    async for chunk in request.stream():
        raw += chunk
        if len(raw) > MAX_BODY_BYTES:
            raise HTTPException(413, f"the body has more than {MAX_BODY_BYTES} bytes")
    return bytes(raw)


async def _form(request: Request) -> str:
    """The token in a login form."""
    text = (await _read(request)).decode(errors="replace")
    return parse_qs(text).get("token", [""])[0]


async def _not_routed(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    return JSONResponse({"error": error.detail}, error.status_code, headers=error.headers)


async def _left(request: Request, error: Exception) -> Response:
    # Nobody reads it.
    return Response(status_code=499)
