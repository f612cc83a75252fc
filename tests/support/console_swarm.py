"""What the tests of the console share: a console, robots and an ego that speak to it, a viewer."""

from __future__ import annotations

import asyncio
import http.client
import json
import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
from prometheus_client import CollectorRegistry

from options.console.__main__ import serve
from options.console.endpoint import Endpoint
from options.console.settings import ConsoleSettings
from swarm import keyspace
from swarm.arrays import Array, pack
from swarm.messages import (
    Beacon,
    Decision,
    Detections,
    GatewayState,
    LinkClass,
    LinkState,
    NetDemand,
    NetState,
)
from swarm.messages import SceneDescription as Scene
from swarm.session import Session

WAIT_S = 20.0
EGO = "R1"


@contextmanager
def console(router: str, swarm: str, **values: Any) -> Iterator[int]:
    """A running console; gives its port."""
    common: dict[str, Any] = {"ego": EGO, "console_port": 0, "log_level": "error"}
    settings = ConsoleSettings(router=router, swarm=swarm, **(common | values))
    endpoint = Endpoint(settings)
    stop = threading.Event()
    registry = CollectorRegistry()
    thread = threading.Thread(target=lambda: asyncio.run(serve(settings, endpoint, registry, stop)))
    thread.start()
    try:
        yield endpoint.port
    finally:
        stop.set()
        thread.join(WAIT_S)
        assert not thread.is_alive()


class Answer(NamedTuple):
    status: int
    headers: dict[str, str]
    body: bytes

    @property
    def error(self) -> str:
        return str(json.loads(self.body)["error"])


def ask(port: int, method: str, path: str, body: Any = None, **headers: str) -> Answer:
    """One request; `Host=...` and the like as keywords, with _ for -."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=WAIT_S)
    try:
        raw = body if isinstance(body, str) or body is None else json.dumps(body)
        connection.request(method, path, raw, {k.replace("_", "-"): v for k, v in headers.items()})
        response = connection.getresponse()
        found = {name.lower(): value for name, value in response.getheaders()}
        return Answer(response.status, found, response.read())
    finally:
        connection.close()


class Viewer:
    """An open page, as far as the stream goes."""

    def __init__(self, port: int, ego: str = "", **headers: str) -> None:
        self.port = port
        self._connection = http.client.HTTPConnection("127.0.0.1", port, timeout=WAIT_S)
        query = f"?ego={ego}" if ego else ""
        self._connection.request("GET", f"/api/events{query}", headers=headers)
        self.response = self._connection.getresponse()
        self.state: dict[str, Any] = {}
        self.history: list[dict[str, Any]] = []
        self.faults: list[dict[str, Any]] = []
        self.csrf = ""
        self.events = 0
        self.now = 0.0

    def next(self) -> dict[str, Any]:
        """Takes in the next event."""
        line = self.response.readline()
        assert line.startswith(b"data: "), line
        assert self.response.readline() == b"\n"
        event: dict[str, Any] = json.loads(line.removeprefix(b"data: "))
        assert event.get("full", False) == (self.events == 0)
        self.events += 1
        self.csrf = event.get("csrf", self.csrf)
        self.state |= event["state"]
        self.history += event["history"]
        self.faults += event["faults"]
        self.now = event["now"]
        return event

    def until(self, holds: Callable[[], bool], what: str, timeout_s: float = WAIT_S) -> None:
        """Reads on until something holds, of the whole state."""
        deadline = time.monotonic() + timeout_s
        if not self.events:
            self.next()
        while not holds():
            assert time.monotonic() < deadline, what
            self.next()

    def shape(self, body: Any, **headers: str) -> Answer:
        """What the page's control of links sends."""
        return self.post("shape", body, **headers)

    def post(self, what: str, body: Any, **headers: str) -> Answer:
        """What the page's controls send."""
        sent = {
            "Origin": f"http://127.0.0.1:{self.port}",
            "Content-Type": "application/json",
            "X-CoAdapt-CSRF": self.csrf,
        }
        return ask(self.port, "POST", f"/api/{what}", body, **(sent | headers))

    def __enter__(self) -> Viewer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self.response.close()
        self._connection.close()


def rows(columns: int, *values: tuple[float, ...]) -> Array:
    return pack(np.array(values, np.float32).reshape(-1, columns))


class Speakers:
    """A session that plays robots, their ego and the network controller: real messages."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._swarm = session.swarm
        self.seq = 0

    def robot(self, robot: str, x: float, y: float, yaw: float = 0.0) -> None:
        """A beacon."""
        self.seq += 1
        message = Beacon(
            robot=robot,
            instance=1,
            seq=self.seq,
            sent_ns=time.time_ns(),
            capture_ns=time.time_ns(),
            frame=self.seq,
            pose=(x, y, 0.6, 0.0, 0.0, yaw),
            velocity=(math.cos(yaw), math.sin(yaw), 0.0),
            range_m=30.0,
            sizes={"early": 4000, "late": 400},
        )
        self._session.put(keyspace.beacon(self._swarm, robot), message)

    def scene(self, robot: str, x: float, y: float, visible: Array, objects: Array) -> None:
        """A scene description."""
        self.seq += 1
        message = Scene(
            robot=robot,
            instance=1,
            seq=self.seq,
            sent_ns=time.time_ns(),
            capture_ns=time.time_ns(),
            frame=self.seq,
            pose=(x, y, 0.6, 0.0, 0.0, 0.0),
            objects=objects,
            visible_m=visible,
            ground_points=100,
            elapsed_ms=4.0,
        )
        self._session.put(keyspace.scene(self._swarm, robot), message)

    def decision(self, cycle: int, *participants: str, ego: str = EGO, **values: Any) -> None:
        """A decision of an ego."""
        common: dict[str, Any] = {
            "algorithm": "early",
            "reason": f"{len(participants)} see more",
            "source": "policy",
            "policy": "coverage",
            "valid": True,
            "quality": 0.9,
            "cost_bytes": 20_000,
            "capacity_bps": 5e6,
        }
        message = Decision(
            ego=ego,
            cycle=cycle,
            decided_ns=time.time_ns(),
            participants=participants,
            **(common | values),
        )
        self._session.put(keyspace.decision(self._swarm, ego), message)

    def detections(
        self,
        *boxes: tuple[float, ...],
        scores: tuple[float, ...] = (),
        operating_point: float | None = None,
        **received: int,
    ) -> None:
        """Fused boxes (x, y, z, l, w, h, heading) with scores, 0.9 unless told otherwise, and what
        was received for them."""
        self.seq += 1
        message = Detections(
            ego=EGO,
            cycle=1,
            frame=self.seq,
            capture_ns=time.time_ns(),
            algorithm="early",
            participants=(EGO, *received),
            boxes=rows(7, *boxes),
            scores=rows(1, *[(score,) for score in scores or (0.9,) * len(boxes)]),
            operating_point=operating_point,
            labels=("robot",) * len(boxes),
            bytes=received,
            latency_ms=31.0,
        )
        self._session.put(keyspace.detections(self._swarm, EGO), message)

    def demand(self, *, reachable: bool) -> None:
        """What the ego needs of its cell."""
        message = NetDemand(
            ego=EGO,
            cycle=1,
            sent_ns=time.time_ns(),
            needed_bytes_s=200_000,
            possible=True,
            reachable=reachable,
            unreachable_s=0.0,
            quality=0.8,
            q_min=0.7,
            capacity_bps=5_000_000,
        )
        self._session.put(keyspace.net_demand(self._swarm), message)

    def gateway_state(self, trouble: str) -> None:
        """How the LLM gateway stands with its model."""
        message = GatewayState(model="test-model", trouble=trouble)
        self._session.put(keyspace.llm_state(self._swarm), message)

    def net_state(self, capacity_bps: int, used_bps: int) -> None:
        """The cell towards the ego, as the network controller measures it."""
        fusion = LinkClass(
            rate_bps=capacity_bps,
            ceil_bps=capacity_bps,
            priority=1,
            throughput_bps=used_bps,
            sent_bytes=1,
            backlog_bytes=0,
            drops=0,
            overlimits=0,
        )
        link = LinkState(
            robot=EGO,
            direction="down",
            capacity_bps=capacity_bps,
            available_bps=capacity_bps - used_bps,
            latency_ms=2.0,
            level=0,
            classes={"fusion": fusion},
        )
        now_ns = time.time_ns()
        message = NetState(controller=1, seq=now_ns, sent_ns=now_ns, links=(link,))
        self._session.put(keyspace.net_state(self._swarm), message)
