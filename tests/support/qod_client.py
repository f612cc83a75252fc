"""A client, a sink and a network for tests of the Quality-on-Demand API."""

from __future__ import annotations

import http.client
import json
import queue
import ssl
import threading
from collections.abc import Collection, Generator
from contextlib import closing, contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, NamedTuple

from prometheus_client import CollectorRegistry

from network_controller.qod.server import Server
from swarm.errors import NetworkError
from swarm.log import make_logger

SESSIONS = "/quality-on-demand/v1/sessions"
RETRIEVE = "/quality-on-demand/v1/retrieve-sessions"
PROFILES = "/qos-profiles/v1/qos-profiles"
RETRIEVE_PROFILES = "/qos-profiles/v1/retrieve-qos-profiles"
LOOPBACK = ("127.0.0.0/8",)
"""Lets tests have their sinks where they run."""
LOG = make_logger("test", level="critical")


class Links:
    """The controller's side: who has which address, and what is held."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        self.robots = {"10.77.0.2": "R1", "10.77.0.3": "R2", "10.77.0.4": "R3"}
        self.capacities = {"R1": 5_000_000, "R2": 20_000_000}
        self.holds: dict[str, tuple[str, int]] = {}
        self.broken = ""

    def robot_at(self, ipv4: str) -> str | None:
        return self.robots.get(ipv4)

    def capacity_bps(self, robot: str) -> int | None:
        return self.capacities.get(robot)

    def hold(self, session_id: str, robot: str, level: int) -> None:
        if self.broken:
            raise NetworkError(self.broken)
        self.holds[session_id] = (robot, level)

    def release(self, session_id: str) -> None:
        self.holds.pop(session_id, None)


class Reply(NamedTuple):
    status: int
    headers: dict[str, str]
    body: Any


class Api:
    """A client of a server that is really there."""

    def __init__(self, server: Server, links: Links, registry: CollectorRegistry) -> None:
        self.server = server
        self.links = links
        self.registry = registry

    def send(
        self,
        method: str,
        path: str,
        body: Any = None,
        *,
        raw: bytes | None = None,
        headers: dict[str, str] | None = None,
    ) -> Reply:
        """One request over a connection of its own."""
        data = raw if body is None else json.dumps(body).encode()
        sent = {"Content-Type": "application/json"} if data is not None else {}
        with closing(http.client.HTTPConnection("127.0.0.1", self.server.port, timeout=10)) as to:
            to.request(method, path, data, sent | (headers or {}))
            response = to.getresponse()
            answer = response.read()
            names = {name.lower(): value for name, value in response.getheaders()}
            return Reply(response.status, names, json.loads(answer) if answer else None)

    def create(self, **changes: Any) -> Reply:
        return self.send("POST", SESSIONS, wish(**changes))

    def count(self, name: str, **labels: str) -> float:
        return self.registry.get_sample_value(name, labels) or 0.0


def wish(**changes: Any) -> dict[str, Any]:
    """A body for createSession; a change of None leaves a field out."""
    body = {
        "device": device("10.77.0.2"),
        "applicationServer": {"ipv4Address": "10.77.0.1"},
        "qosProfile": "QOS_L",
        "duration": 60,
    }
    return {name: value for name, value in (body | changes).items() if value is not None}


def device(address: str) -> dict[str, Any]:
    return {"ipv4Address": {"publicAddress": address, "privateAddress": address}}


@contextmanager
def served(
    links: Links | None = None,
    token: str = "",
    names: Collection[str] = (),
    sinks: Collection[str] = (),
) -> Generator[Api]:
    """The API on a free port."""
    links, registry = links or Links(), CollectorRegistry()
    server = Server(links, "127.0.0.1", 0, token, registry, LOG, names=names, sinks=sinks)
    server.start()
    try:
        yield Api(server, links, registry)
    finally:
        server.close()


class Received(NamedTuple):
    path: str
    headers: dict[str, str]
    event: dict[str, Any]


class Sink:
    """Where events arrive; answers with `statuses` in turn, then with 204."""

    def __init__(self, server: ThreadingHTTPServer, url: str) -> None:
        self.server = server
        self.url = url
        self.received: queue.Queue[Received] = queue.Queue()
        self.statuses: list[int] = []
        self.location = "/elsewhere"
        self.hold = threading.Event()
        self.hold.set()

    def next(self) -> Received:
        return self.received.get(timeout=20)


@contextmanager
def listening(context: ssl.SSLContext | None = None) -> Generator[Sink]:
    """A sink on a free port of the loopback."""

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["Content-Length"]))
            names = {name.lower(): value for name, value in self.headers.items()}
            sink.received.put(Received(self.path, names, json.loads(body)))
            sink.hold.wait(20)
            self.send_response(sink.statuses.pop(0) if sink.statuses else 204)
            self.send_header("Location", sink.location)
            self.send_header("Content-Length", "0")
            self.end_headers()

        def log_message(self, format: str, *args: object) -> None: ...

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    scheme = "http"
    if context is not None:
        server.socket = context.wrap_socket(server.socket, server_side=True)
        scheme = "https"
    sink = Sink(server, f"{scheme}://127.0.0.1:{server.server_port}/events?of=qod")
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05})
    thread.start()
    try:
        yield sink
    finally:
        sink.hold.set()
        server.shutdown()
        server.server_close()
        thread.join()
