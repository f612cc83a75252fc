"""Whole swarms that ask a language model: on a server outside, and embedded."""

from __future__ import annotations

import asyncio
import importlib.util
import json
import signal
import tempfile
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from deploy.netns import launch
from deploy.observe import Watch
from deploy.paths import journal_path
from deploy.ready import wait_ready
from deploy.runtimes.netns import NetnsRuntime
from deploy.spec import factory_robots, make_spec
from deploy.state import State, need_state
from deploy.view import SwarmView
from ego_agent.knowledge.journal import read_journal
from tests.support.deploy_support import await_
from tests.support.free_ports import free_port
from tests.support.model_server import ModelServer, Request, says
from tests.support.paths import REPOSITORY

READY_S = 120.0
ANSWER_S = 120.0
REASON = "the server's own words"
KEY = "sk-only-for-the-gateway"
_refused = launch.why_not()
pytestmark = pytest.mark.skipif(_refused is not None, reason=str(_refused))


@contextmanager
def swarm_with(llm: str, **more: Any) -> Iterator[State]:
    """Three robots, an ego that asks, and a gateway."""
    with (
        tempfile.TemporaryDirectory(prefix="cl-", dir="/tmp") as directory,
        pytest.MonkeyPatch.context() as patch,
    ):
        patch.setenv("COADAPT_RUN_DIR", f"{directory}/run")
        patch.setenv("PYTHONPATH", str(REPOSITORY))
        patch.setenv("COADAPT_LLM_API_KEY", KEY)
        # Whatever the model chooses is followed if it can be: here it is the way that counts.
        patch.setenv("COADAPT_LLM_VALUE_MARGIN", "1")
        # Nor does it matter how slow the machine is.
        patch.setenv("COADAPT_LLM_DEADLINE_S", "120")
        spec = make_spec(
            **{"swarm": "advised", "robots": factory_robots(3), "rings": 16, "q_min": 0.0} | more,
            policy="llm",
            llm=llm,
            prometheus=False,
            ego_metrics_port=free_port(),
            qod_port=free_port(),
            llm_port=free_port(),
            var_dir=f"{directory}/var",
        )
        runtime = NetnsRuntime()
        assert runtime.up(spec)
        try:
            wait_ready(runtime, need_state(spec.swarm), READY_S)
            yield need_state(spec.swarm)
        finally:
            runtime.down(spec.swarm)


async def chooses(
    reader: asyncio.StreamReader, writer: asyncio.StreamWriter, request: Request
) -> None:
    """Answers with the first of what the schema allows, and as many robots."""
    schema = request.body["response_format"]["json_schema"]["schema"]
    properties = schema.get("anyOf", [schema])[0]["properties"]
    helpers = properties["helpers"]
    answer = {name: part.get("enum", [None])[0] for name, part in properties.items()} | {
        "helpers": helpers["items"]["enum"][: helpers["maxItems"]] if "items" in helpers else [],
        "explanation": REASON,
    }
    await says(json.dumps(answer))(reader, writer, request)


def until_source(watch: Watch, *sources: str, timeout_s: float = ANSWER_S) -> SwarmView:
    """The first view of a decision that came so."""

    def seen() -> SwarmView | None:
        view = watch.view()
        return view if view.source in sources else None

    view = await_(seen, f"a decision from {' or '.join(sources)}", timeout_s)
    assert view is not None
    return view


def test_a_server_outside_advises_the_ego_and_a_killed_gateway_comes_back() -> None:
    server = ModelServer()
    server.otherwise = chooses
    server.start()
    try:
        with swarm_with(f"{server.url}/v1") as state, Watch(state) as watch:
            view = until_source(watch, "llm", "hold")
            assert view.advice is not None
            assert server.next().headers["authorization"] == f"Bearer {KEY}"
            runtime, swarm = NetnsRuntime(), state.spec.swarm
            asked = watch.view().cycle or 0
            runtime.kill(swarm, "gateway", signal.SIGKILL)

            def again() -> bool:
                found = {one.service: one.restarts for one in runtime.status(swarm)}
                return found["gateway"] == 1

            # On an idle machine it may be back within one cycle, of which no decision tells.
            await_(again, "the gateway is started again")
            await_(lambda: (watch.view().cycle or 0) >= asked + 5, "cycles with and without it")
            until_source(watch, "llm", "cache", "hold")
            with urllib.request.urlopen(f"{state.llm_url}/v1/models", timeout=30) as answer:
                assert json.load(answer)["data"][0]["id"] == "test-model"
            lines = list(read_journal(Path(journal_path(state.spec, state.spec.var_dir))))
            assert all(line.decision.valid for line in lines)
            advised = [one.decision for one in lines if one.decision.source in ("llm", "cache")]
            assert {one.model for one in advised} == {"test-model"}
            # What the ego itself says behind it: before its first frames arrive it is blind.
            assert all(f'test-model says: "{REASON}"' in one.reason for one in advised)
            assert all(one.reason.startswith("The ego and ") for one in advised)
            told = [p for p in Path(state.spec.var_dir).rglob("*") if p.is_file()]
            assert told
            assert not [path for path in told if KEY.encode() in path.read_bytes()]
    finally:
        server.stop()


@pytest.mark.timeout(400)
@pytest.mark.skipif(
    importlib.util.find_spec("llama_cpp") is None,
    reason="the embedded model is not installed: make setup EXTRA=llm",
)
def test_the_embedded_model_advises_the_ego() -> None:
    with swarm_with("embedded", swarm="embedded", period_s=2.0) as state, Watch(state) as watch:
        view = until_source(watch, "llm", "cache", "hold", timeout_s=300)
        assert view.selected is not None
        assert view.selected[0] == "R1"

        def models() -> set[str]:
            lines = read_journal(Path(journal_path(state.spec, state.spec.var_dir)))
            return {line.decision.model for line in lines if line.decision.model}

        # A line is written when its cycle has ended.
        assert await_(models, "the journal's line") == {"SmolLM2-135M-Instruct.Q4_1"}
