"""The gateway's process and its endpoint for egos, on a real router."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import subprocess
import sys
import threading
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from llm_gateway.loop import LoopThread
from llm_gateway.model import Prompt
from llm_gateway.zenoh_endpoint import ZenohEndpoint
from swarm import keyspace
from swarm.errors import RefusedError
from swarm.listening import hear
from swarm.messages import (
    MAX_PROMPT_CHARS,
    ChatMessage,
    DecideAnswer,
    DecideRequest,
    GatewayState,
)
from swarm.session import Session
from swarm.traffic import TrafficClass
from tests.support.free_ports import free_port
from tests.support.llm_scripted import EARLY, SCHEMA, Rig, Scripted
from tests.support.model_server import ModelServer
from tests.support.zenoh_fixtures import (
    WAIT_S,
    Inbox,
    RouterProcess,
    SessionMaker,
    until,
    wait_until_served,
)

Start = Callable[..., subprocess.Popen[str]]


@pytest.fixture
def start(shared_router: RouterProcess, swarm_name: str) -> Iterator[Start]:
    """Starts gateway processes; ends them after the test."""
    with ExitStack() as stack:

        def make(**settings: str) -> subprocess.Popen[str]:
            kept = {k: v for k, v in os.environ.items() if not k.startswith("COADAPT_")}
            ours = {
                "SWARM": swarm_name,
                "ROUTER": shared_router.address,
                "METRICS_PORT": "0",
                "LLM_HTTP_PORT": "0",
                **settings,
            }
            process = stack.enter_context(
                subprocess.Popen(
                    [sys.executable, "-m", "llm_gateway"],
                    env=kept | {f"COADAPT_{key}": value for key, value in ours.items()},
                    stderr=subprocess.PIPE,
                    text=True,
                )
            )
            stack.callback(process.kill)
            return process

        yield make


@pytest.fixture
def ego(shared_router: RouterProcess, open_session: SessionMaker) -> Session:
    return open_session(shared_router.address)


@pytest.fixture
def loop() -> Iterator[LoopThread]:
    thread = LoopThread()
    yield thread
    thread.close()


def request(words: str = "which?", **changes: object) -> DecideRequest:
    values: dict[str, object] = {
        "request": 7,
        "ego": "E1",
        "messages": (ChatMessage("user", words),),
        "schema": SCHEMA,
        "deadline_s": 10.0,
        **changes,
    }
    return DecideRequest(**values)  # type: ignore[arg-type]


def ask(session: Session, asked: DecideRequest) -> DecideAnswer:
    key = keyspace.llm_decide(session.swarm)
    future = session.ask(
        key, asked, DecideAnswer, timeout_s=asked.deadline_s + 2, traffic=TrafficClass.CONTROL
    )
    return future.result(WAIT_S).message


def gateways(session: Session) -> Inbox[bool]:
    inbox: Inbox[bool] = Inbox()
    session.watch_gateway(inbox.put)
    return inbox


def event(process: subprocess.Popen[str], name: str) -> dict[str, object]:
    """The next log line of a kind."""
    assert process.stderr is not None
    for line in process.stderr:
        if line.startswith("{") and (told := json.loads(line))["event"] == name:
            return dict(told)
    raise AssertionError(f"the process ended without {name}")


async def say_early(prompt: Prompt, timeout_s: float) -> str:
    return EARLY


def serve(
    session: Session, loop: LoopThread, script: Callable[..., object] | None, **options: object
) -> Rig:
    """A gateway with its endpoint on a session."""

    async def make() -> Rig:
        made = Rig(Scripted(script), None, **options)  # type: ignore[arg-type]
        await made.gateway.start()
        return made

    made = loop.submit(make()).result(WAIT_S)
    ZenohEndpoint(made.gateway, loop.loop).open(session)
    return made


def test_egos_get_answers_from_the_model_and_the_cache(
    pair: tuple[Session, Session], loop: LoopThread
) -> None:
    ego, site = pair
    alive = gateways(ego)
    serve(site, loop, say_early)
    assert alive.next()
    wait_until_served(ego, keyspace.llm_decide(ego.swarm))
    first = ask(ego, request(fingerprint="0123456789abcdef"))
    assert (first.request, first.decision, first.source, first.hit) == (7, EARLY, "llm", "")
    assert first.tokens.prompt == 9
    again = ask(ego, request(fingerprint="0123456789abcdef", request=8))
    assert (again.request, again.source, again.hit) == (8, "cache", "exact")
    similar = ask(ego, request("again?", fingerprint="0123456789abcdef"))
    assert (similar.hit, similar.decision) == ("fingerprint", EARLY)


@pytest.mark.stumble(
    "an unreachable model server shows in no event",
    command="make up LLM=http://127.0.0.1:9 MODEL=x; make status",
)
def test_the_swarm_hears_that_the_model_server_cannot_be_reached_and_is_back(
    start: Start, ego: Session
) -> None:
    port = free_port()
    states: Inbox[GatewayState] = Inbox()
    hear(ego, {GatewayState: states.put})
    start(LLM_BACKEND="openai", LLM_URL=f"http://127.0.0.1:{port}", LLM_MODEL="m")
    first = states.next()
    assert (first.model, first.trouble) == ("m", f"refused by 127.0.0.1:{port}")
    server = ModelServer()
    server.port = port
    server.start()
    try:
        while states.next().trouble:
            pass
    finally:
        server.stop()


def test_a_hundred_egos_at_once_all_get_their_answer(
    pair: tuple[Session, Session], loop: LoopThread
) -> None:
    ego, site = pair
    made = serve(site, loop, None, window_ms=5.0)
    key = keyspace.llm_decide(ego.swarm)
    wait_until_served(ego, key)
    asked = [
        ego.ask(key, request(f"{i % 10}", ego=f"E{i}"), DecideAnswer, timeout_s=WAIT_S)
        for i in range(100)
    ]
    until(lambda: made.count("joined_total") == 90, "all wait for ten calls")
    loop.loop.call_soon_threadsafe(made.backend.go.set)
    assert {future.result(WAIT_S).message.decision for future in asked} == {EARLY}
    assert made.count("model_calls_total") == 10


def test_an_ego_that_waits_too_long_is_told_so(
    pair: tuple[Session, Session], loop: LoopThread
) -> None:
    ego, site = pair
    serve(site, loop, None)
    wait_until_served(ego, keyspace.llm_decide(ego.swarm))
    with pytest.raises(RefusedError, match="expired: no answer after"):
        ask(ego, request(deadline_s=0.1))


def test_a_closed_gateway_says_so(pair: tuple[Session, Session], loop: LoopThread) -> None:
    ego, site = pair
    made = serve(site, loop, None)
    wait_until_served(ego, keyspace.llm_decide(ego.swarm))
    loop.submit(made.gateway.close()).result(WAIT_S)
    with pytest.raises(RefusedError, match="unavailable: the gateway is closing"):
        ask(ego, request())


@pytest.mark.slow
def test_ten_megabytes_are_refused_and_the_next_request_is_answered(
    pair: tuple[Session, Session], loop: LoopThread
) -> None:
    ego, site = pair
    serve(site, loop, say_early)
    key = keyspace.llm_decide(ego.swarm)
    wait_until_served(ego, key)
    for payload in (b"\xc1" * 10_000_000, b"\xdb\x00\x98\x96\x80" + b"x" * 10_000_000):
        replies = list(ego._connection.zenoh.get(key, payload=payload, timeout=WAIT_S))
        assert replies
        assert all(reply.ok is None for reply in replies)
    # Every message small enough for the wire, all together too large for a model.
    many = tuple(ChatMessage("user", "x" * 150_000) for _ in range(2))
    with pytest.raises(RefusedError, match=f"too_large: .* allowed: {MAX_PROMPT_CHARS}"):
        ask(ego, request(messages=many))
    assert ask(ego, request()).decision == EARLY


def test_a_process_without_a_model_refuses_and_leaves_on_a_signal(
    start: Start, ego: Session
) -> None:
    alive = gateways(ego)
    process = start(LLM_BACKEND="none")
    told = event(process, "gateway_up")
    assert told["backend"] == "none"
    assert alive.next()
    wait_until_served(ego, keyspace.llm_decide(ego.swarm))
    with pytest.raises(RefusedError, match="unavailable: no model"):
        ask(ego, request())
    metrics = f"http://127.0.0.1:{told['metrics_port']}/metrics"
    with urllib.request.urlopen(metrics, timeout=WAIT_S) as answer:
        text = answer.read().decode()
    assert 'coadapt_llm_requests_total{outcome="unavailable",source="llm"} 1.0' in text
    process.send_signal(signal.SIGTERM)
    assert process.wait(WAIT_S) == 0
    assert not alive.next()


class SilentServer:
    """A model server that takes requests and never answers."""

    def __init__(self) -> None:
        self.asked = threading.Event()
        self.port = free_port()
        self._thread = LoopThread()
        self._server = self._thread.submit(self._listen()).result(WAIT_S)

    async def _listen(self) -> asyncio.Server:
        return await asyncio.start_server(self._take, "127.0.0.1", self.port)

    async def _take(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            head = await reader.readuntil(b"\r\n")
            if b"chat/completions" in head:
                self.asked.set()
            while await reader.read(65_536):
                pass
        except (OSError, asyncio.IncompleteReadError):
            pass
        finally:
            writer.close()

    def close(self) -> None:
        async def end() -> None:
            self._server.close()

        self._thread.submit(end()).result(WAIT_S)
        self._thread.close()


def test_a_signal_ends_the_process_with_requests_under_way(start: Start, ego: Session) -> None:
    server = SilentServer()
    try:
        process = start(
            LLM_BACKEND="openai",
            LLM_URL=f"http://127.0.0.1:{server.port}/v1",
            LLM_MODEL="m",
            LLM_API_KEY="sk-very-secret",
            LLM_PARALLEL="1",
            LOG_LEVEL="debug",
        )
        event(process, "router_reached")
        key = keyspace.llm_decide(ego.swarm)
        wait_until_served(ego, key)
        asked = [
            ego.ask(key, request(str(i), deadline_s=60), DecideAnswer, timeout_s=60)
            for i in range(3)
        ]
        assert server.asked.wait(WAIT_S)
        process.send_signal(signal.SIGTERM)
        for future in asked:
            with pytest.raises(RefusedError, match="unavailable: the gateway is closing"):
                future.result(WAIT_S)
        _, logged = process.communicate(timeout=WAIT_S)
        assert process.returncode == 0
        assert "gateway_down" in logged
        assert "secret" not in logged
    finally:
        server.close()


def test_a_killed_gateway_is_missed_and_its_cache_is_there_for_the_next(
    start: Start, ego: Session, tmp_path: Path
) -> None:
    alive = gateways(ego)
    process = start(LLM_CACHE=str(tmp_path / "cache.db"))
    assert alive.next()
    process.kill()
    assert not alive.next()
    assert (tmp_path / "cache.db").exists()
    start(LLM_CACHE=str(tmp_path / "cache.db"))
    assert alive.next()


def test_a_gateway_ends_also_before_it_has_found_its_router(start: Start) -> None:
    process = start(ROUTER=f"tcp/127.0.0.1:{free_port()}")
    event(process, "gateway_up")
    process.send_signal(signal.SIGTERM)
    assert process.wait(WAIT_S) == 0


def test_a_gateway_outlives_its_router(
    start: Start, own_router: RouterProcess, open_session: SessionMaker
) -> None:
    ego = open_session(own_router.address)
    alive = gateways(ego)
    start(ROUTER=own_router.address)
    assert alive.next()
    own_router.stop(kill=True)
    until(lambda: ego.links() == 0, "the router is away")
    own_router.start()
    wait_until_served(ego, keyspace.llm_decide(ego.swarm))
    with pytest.raises(RefusedError, match="unavailable: no model"):
        ask(ego, request())


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"LLM_BACKEND": "oracle"}, "COADAPT_LLM_BACKEND = 'oracle'"),
        ({"LLM_BACKEND": "openai", "LLM_URL": "here"}, "COADAPT_LLM_URL"),
        ({"LLM_API_KEY_FILE": "/nonexistent"}, "COADAPT_LLM_API_KEY_FILE = '/nonexistent'"),
        ({"LLM_HTTP_HOST": "0.0.0.0"}, "COADAPT_LLM_HTTP_TOKEN is not set"),
        ({"ROUTER": "here"}, "router 'here' is not valid"),
    ],
)
def test_a_wrong_setting_ends_the_process_with_one_clear_line(
    settings: dict[str, str], told: str, start: Start
) -> None:
    process = start(**settings)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 1
    lines = [line for line in errors.splitlines() if not line.startswith("{")]
    assert len(lines) == 1
    assert lines[0].startswith("llm_gateway: ")
    assert told in lines[0]
