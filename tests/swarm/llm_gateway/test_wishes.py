"""Wishes over both endpoints of the gateway: what comes back is an intent, or why there is none."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from llm_gateway.loop import LoopThread
from llm_gateway.model import Completion, Job, Prompt
from llm_gateway.zenoh_endpoint import ZenohEndpoint
from swarm import keyspace
from swarm.errors import GatewayError, RefusedError
from swarm.messages import Intent, LlmTimings, LlmTokens, Site, WishAnswer, WishRequest
from swarm.session import Session
from swarm.traffic import TrafficClass
from tests.support.llm_endpoint import Scripted as Endpoint
from tests.support.llm_endpoint import endpoint_of
from tests.support.llm_scripted import Rig, Scripted
from tests.support.zenoh_fixtures import WAIT_S, wait_until_served

SITE = Site(robots=("R1", "R3"), places=("docks",), classes=("person",))
WISH = "leave R3 alone and watch the docks, save bandwidth until six"
NOW = "2027-01-15T12:00:00+01:00"
ROLES = json.dumps({"words": ["out", "high", "save", "when", "all"]})
MEANT = {
    "exclude": ["R3"],
    "focus": [{"place": "docks", "weight": "high"}],
    "save": "bandwidth",
    "until": "2027-01-15T18:00:00+01:00",
    "unclear": [],
    "only": None,
}


@pytest.fixture
def loop() -> Iterator[LoopThread]:
    thread = LoopThread()
    yield thread
    thread.close()


def serve(session: Session, loop: LoopThread, script: Callable[..., Any] | None) -> None:
    """A gateway with its endpoint on a session."""

    async def make() -> Rig:
        made = Rig(Scripted(script), None)
        await made.gateway.start()
        return made

    made = loop.submit(make()).result(WAIT_S)
    ZenohEndpoint(made.gateway, loop.loop).open(session)


def ask(session: Session, **changes: Any) -> Intent:
    values: dict[str, Any] = {"wish": WISH, "site": SITE, "now": NOW, "request": 3, **changes}
    answer = session.ask(
        keyspace.llm_wish(session.swarm),
        WishRequest(**values),
        WishAnswer,
        timeout_s=WAIT_S,
        traffic=TrafficClass.CONTROL,
    )
    reply = answer.result(WAIT_S).message
    assert reply.request == 3
    return reply.understood


def test_a_wish_comes_back_as_an_intent_with_the_model_that_understood_it(
    pair: tuple[Session, Session], loop: LoopThread
) -> None:
    tool, site = pair
    prompts: list[Prompt] = []

    async def say(prompt: Prompt, timeout_s: float) -> str:
        prompts.append(prompt)
        return ROLES

    serve(site, loop, say)
    wait_until_served(tool, keyspace.llm_wish(tool.swarm))
    intent = ask(tool)
    assert (intent.exclude, intent.save, intent.until) == (("R3",), "bandwidth", MEANT["until"])
    assert intent.model == "scripted"
    assert "leave [R3] alone" in prompts[0].messages[-1].content
    # What is no wish, or too long for one, costs the model nothing.
    for wish in ("hello there", "x" * 10_000):
        assert ask(tool, wish=wish).is_empty()
    assert len(prompts) == 1
    for now in ("noon", "2027-01-15T12:00:00"):
        with pytest.raises(RefusedError, match="now"):
            ask(tool, now=now)


def test_a_model_that_hangs_or_babbles_gives_an_error_and_no_intent(
    pair: tuple[Session, Session], loop: LoopThread
) -> None:
    tool, site = pair
    said = ""

    async def say(prompt: Prompt, timeout_s: float) -> str:
        if not said:
            await asyncio.Event().wait()
        return said

    serve(site, loop, say)
    wait_until_served(tool, keyspace.llm_wish(tool.swarm))
    for babble in ("no JSON", '{"words": ["out"]}'):
        said = babble
        with pytest.raises(RefusedError) as refused:
            ask(tool)
        assert refused.value.code == "invalid"
    said = ""
    with pytest.raises(RefusedError) as refused:
        ask(tool, deadline_s=0.5)
    assert refused.value.code == "expired"


def test_http_clients_are_answered_with_the_intent_alone() -> None:
    gateway = Endpoint()

    async def say(job: Job) -> Completion:
        return Completion(
            text=ROLES,
            source="llm",
            hit="",
            model="m",
            age_s=0.0,
            tokens=LlmTokens(),
            timings=LlmTimings(),
        )

    gateway.answer = say
    body = {"wish": WISH, "now": NOW, "site": {"robots": ["R1", "R3"], "places": ["docks"]}}
    with endpoint_of(gateway) as client:
        answer = client.send("POST", "/v1/wishes", json.dumps(body).encode())
        assert answer.status == 200
        assert {name: answer.body[name] for name in MEANT} == MEANT
        for wrong in ({}, body | {"wish": 3}, body | {"site": {"robots": ["R 1"]}}):
            refused = client.send("POST", "/v1/wishes", json.dumps(wrong).encode())
            assert refused.status == 400
            assert "the wish is not valid" in refused.error["message"]
        assert (
            client.send("POST", "/v1/wishes", b"{}", {"Content-Type": "text/plain"}).status == 415
        )

        async def fail(job: Job) -> Completion:
            raise GatewayError("unavailable", "no model")

        gateway.answer = fail
        away = client.send("POST", "/v1/wishes", json.dumps(body).encode())
        assert (away.status, away.error["code"]) == (503, "unavailable")
