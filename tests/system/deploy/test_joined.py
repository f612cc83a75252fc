"""Prometheus finds processes that join a swarm, and forgets those that leave."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from prometheus_client import CollectorRegistry, Gauge

from deploy.prometheus import Prometheus
from deploy.services import Service, prometheus_config
from swarm.announce import announce
from swarm.metrics import MetricsServer
from swarm.process import SwarmSettings
from swarm.trust.roles import Role
from tests.support.deploy_support import await_
from tests.support.free_ports import free_port
from tests.support.zenoh_fixtures import RouterProcess, SessionMaker

pytestmark = pytest.mark.skipif(
    shutil.which("prometheus") is None, reason="prometheus is not installed"
)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "targets" / "joined.json"


@pytest.fixture
def router(file: Path, swarm_name: str) -> Iterator[RouterProcess]:
    router = RouterProcess("--swarm", swarm_name, "--targets", str(file))
    yield router
    router.stop()


@pytest.fixture
def prometheus(file: Path, tmp_path: Path) -> Iterator[Prometheus]:
    """One that was started with R1 in its roster."""
    port = free_port()
    roster = (Service(name="robot-R1", role="robot", host="R1", argv=(), metrics_port=9),)
    (tmp_path / "alerts.yml").write_text("groups: []\n")
    text = prometheus_config(roster, lambda s: "127.0.0.1", str(tmp_path / "alerts.yml"), str(file))
    (tmp_path / "prometheus.yml").write_text(text)
    with (
        open(tmp_path / "log", "w") as log,
        subprocess.Popen(
            [
                "prometheus",
                f"--config.file={tmp_path / 'prometheus.yml'}",
                f"--storage.tsdb.path={tmp_path / 'data'}",
                f"--web.listen-address=127.0.0.1:{port}",
            ],
            stderr=log,
        ) as process,
    ):
        try:
            yield Prometheus(f"http://127.0.0.1:{port}")
        finally:
            process.kill()


def told(file: Path) -> list[dict[str, Any]]:
    return json.loads(file.read_text()) if file.exists() else []


def instances(file: Path) -> Callable[[], list[str]]:
    return lambda: sorted(one["labels"]["instance"] for one in told(file))


def joined(swarm: str, address: str) -> SwarmSettings:
    return SwarmSettings(swarm=swarm, router=address, metrics_host="127.0.0.1")


def test_a_robot_that_joins_is_scraped_until_it_leaves(
    router: RouterProcess,
    prometheus: Prometheus,
    file: Path,
    swarm_name: str,
    open_session: SessionMaker,
) -> None:
    registry = CollectorRegistry()
    Gauge("coadapt_test_gauge", "A value.", registry=registry).set(42)
    settings = joined(swarm_name, router.address)
    with closing(MetricsServer(registry, 0, "127.0.0.1")) as server:
        session = open_session(router.address)
        for robot in ("R1", "R7"):
            announce(session, settings, Role("robot", robot), server.port)

        def up() -> bool:
            try:
                found = prometheus.query('coadapt_test_gauge{job="robot", robot="R7"}')
            except Exception:
                return False  # It is only starting.
            return [one.labels["instance"] for one in found] == ["robot-R7"]

        await_(up, "its metrics are read")
        # Who was started with the swarm is not read twice.
        assert [t.instance for t in prometheus.targets()].count("robot-R1") == 1
        session.close()
        await_(lambda: instances(file)() == [], "it is forgotten")
        await_(
            lambda: "robot-R7" not in [t.instance for t in prometheus.targets()],
            "it is scraped no more",
        )


def test_a_router_that_starts_anew_forgets_nobody(
    router: RouterProcess, file: Path, swarm_name: str, open_session: SessionMaker
) -> None:
    session = open_session(router.address)
    announce(session, joined(swarm_name, router.address), Role("ego", "R4"), 9102)
    await_(lambda: instances(file)() == ["ego-R4"], "it is told of")
    written = file.stat().st_mtime_ns
    router.stop(kill=True)
    router.start()
    late = open_session(router.address)
    announce(late, joined(swarm_name, router.address), Role("controller", "hall-2"), 9103)
    await_(lambda: instances(file)() == ["controller-hall-2", "ego-R4"], "both are told of")
    assert file.stat().st_mtime_ns > written
    assert not list(file.parent.glob(".*"))
