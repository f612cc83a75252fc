"""Every query of the dashboards on running swarms: none has an empty answer that says nothing."""

from __future__ import annotations

import json
import math
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import pytest

from deploy.dashboards import GRAFANA
from deploy.netns import launch
from deploy.prometheus import Prometheus
from deploy.ready import wait_ready
from deploy.runtimes.netns import NetnsRuntime
from deploy.spec import factory_robots, make_spec
from deploy.state import State, need_state
from tests.support.deploy_support import await_
from tests.support.first_hour import Figure
from tests.support.free_ports import free_port
from tests.support.model_server import serving_model
from tests.support.paths import REPOSITORY

READY_S = 120.0
ANSWERED_S = 60.0
"""`rate` over a minute needs two scrapes, and an ego its first frames."""
NEEDS_MODEL = "needs a language model"
NO_ALERT = "no alert fires"
_refused = launch.why_not()
pytestmark = pytest.mark.skipif(_refused is not None, reason=str(_refused))


class Query(NamedTuple):
    panel: str
    expression: str
    otherwise: str
    """What the panel shows where the answer is empty."""


def queries() -> list[Query]:
    """Of all panels, with Grafana's variables as they are at first."""
    found = []
    for path in sorted(GRAFANA.glob("*.json")):
        for panel in json.loads(path.read_text())["panels"]:
            for target in panel.get("targets", ()):
                expression = re.sub(r"\$(robot|direction)\b", ".*", target["expr"])
                found.append(
                    Query(
                        panel["title"],
                        expression.replace("$__rate_interval", "1m"),
                        panel["fieldConfig"]["defaults"]["noValue"],
                    )
                )
    return found


@contextmanager
def swarm(name: str, **more: Any) -> Iterator[State]:
    """Three robots on a link of 20 Mbit/s, and Prometheus."""
    with (
        tempfile.TemporaryDirectory(prefix="cd-", dir="/tmp") as directory,
        pytest.MonkeyPatch.context() as patch,
    ):
        patch.setenv("COADAPT_RUN_DIR", f"{directory}/run")
        patch.setenv("PYTHONPATH", str(REPOSITORY))
        spec = make_spec(
            swarm=name,
            robots=factory_robots(3),
            rings=16,
            link_bps=20_000_000,
            prometheus_port=free_port(),
            ego_metrics_port=free_port(),
            qod_port=free_port(),
            llm_port=free_port(),
            var_dir=f"{directory}/var",
            **more,
        )
        runtime = NetnsRuntime()
        assert runtime.up(spec)
        try:
            wait_ready(runtime, need_state(name), READY_S)
            yield need_state(name)
        finally:
            runtime.down(name)


def empty(state: State, asked: list[Query]) -> list[Query]:
    server = Prometheus(state.prometheus_url)
    return [query for query in asked if not server.query(query.expression)]


def until_answered(state: State, asked: list[Query]) -> list[Query]:
    """Those that stay empty, without the panel that is empty while all is well."""
    asked = [query for query in asked if query.otherwise != NO_ALERT]
    left: list[Query] = asked

    def none_is_left() -> bool:
        nonlocal left
        left = empty(state, asked)
        return not left

    try:
        await_(none_is_left, "every query is answered", ANSWERED_S)
    except AssertionError:
        return left
    return []


@pytest.mark.stumble(
    "dashboards are silently empty: counters that were never touched are missing",
    command="make up GRAFANA=1",
)
def test_every_query_is_answered_but_those_whose_panel_says_why_not(figure: Figure) -> None:
    asked = queries()
    assert len(asked) > 80
    with swarm("shown") as state:
        left = until_answered(state, [q for q in asked if NEEDS_MODEL not in q.otherwise])
        (error,) = Prometheus(state.prometheus_url).query("coadapt_link_estimate_error_ratio")
    figure("dashboard_queries_empty", len(left))
    assert left == []
    assert math.isfinite(error.value)


@pytest.mark.stumble(
    "panels of the gateway are empty before its first hit, refusal or fault",
    command="make up LLM=http://host:port/v1 GRAFANA=1",
)
def test_with_a_language_model_every_query_is_answered() -> None:
    with (
        serving_model() as server,
        swarm("shown-llm", policy="llm", llm=f"{server.url}/v1") as state,
    ):
        assert until_answered(state, queries()) == []
