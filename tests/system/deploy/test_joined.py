"""Prometheus finds processes that join a swarm, and forgets those that leave."""

from __future__ import annotations

import json
import shutil
import socket
import ssl
import subprocess
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from http.client import HTTPException
from pathlib import Path
from typing import Any

import pytest
from prometheus_client import CollectorRegistry, Gauge

from deploy.prometheus import Prometheus
from deploy.roster import Service
from deploy.scraping import prometheus_config
from swarm.announce import announce
from swarm.errors import DeployError
from swarm.metrics import MetricsServer
from swarm.process import SwarmSettings
from swarm.trust.roles import Role
from swarm.trust.serving import SERVER_NAME
from tests.support.deploy_support import await_
from tests.support.free_ports import free_port
from tests.support.secure_swarm import made_keystore, secure_router
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
    roster = (Service(name="robot-R1", role="robot", host="R1", argv=(), metrics_port=9),)
    with running(tmp_path, roster, file) as server:
        yield server


@contextmanager
def running(
    tmp_path: Path, roster: tuple[Service, ...], file: Path, *, ca: str = "", tls: bool = False
) -> Iterator[Prometheus]:
    """A Prometheus of a swarm that was started with these services."""
    port = free_port()
    alerts = tmp_path / "alerts.yml"
    alerts.write_text("groups: []\n")
    text = prometheus_config(roster, lambda s: "127.0.0.1", str(alerts), str(file), ca=ca, tls=tls)
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


def test_metrics_over_tls_are_read_of_who_the_swarms_authority_knows(
    file: Path, tmp_path: Path, swarm_name: str, open_session: SessionMaker
) -> None:
    store = made_keystore(tmp_path / "keystore", swarm_name, "R1", "R7")
    stranger = made_keystore(tmp_path / "foreign", swarm_name, "R8")
    registry = CollectorRegistry()
    servers = {
        robot: MetricsServer(registry if robot == "R7" else CollectorRegistry(), 0, "127.0.0.1", of)
        for robot, of in (
            ("R1", store.identity("R1")),
            ("R7", store.identity("R7")),
            ("R8", stranger.identity("R8")),
        )
    }
    port = servers["R1"].port
    roster = (Service(name="robot-R1", role="robot", host="R1", argv=(), metrics_port=port),)
    ca = str(store.identity("R1").ca)
    with (
        secure_router(store, swarm_name, "--targets", str(file)) as router,
        running(tmp_path, roster, file, ca=ca, tls=True) as prometheus,
    ):
        for robot in ("R7", "R8"):
            # A certified robot that sends Prometheus to a process of somebody else's.
            session = open_session(router.of("R7"))
            place = f"https:127.0.0.1:{servers[robot].port}"
            name = "R7" if robot == "R7" else "ego-R8"
            session.declare_metrics(name, place)

        def health() -> dict[str, str]:
            try:
                return {t.instance: t.health for t in prometheus.targets()}
            except DeployError:
                return {}

        await_(lambda: health().get("robot-R1") == health().get("robot-R7") == "up", "both are up")
        # Nobody tells of metrics in another's name.
        assert instances(file)() == ["robot-R7"]
        before = prometheus.query('process_start_time_seconds{robot="R7"}')
        assert before
        # A certificate that is renewed while the process runs is shown from then on.
        held = store.identity("R7").certificate.read_bytes()
        store.renew("R7")
        assert store.identity("R7").certificate.read_bytes() != held
        assert shown(servers["R7"].port) == store.identity("R7").certificate.read_text()
        assert health()["robot-R7"] == "up"
    with pytest.raises(ssl.SSLError):
        asked(servers["R8"].port, ca)
    assert b"process_start_time_seconds" in asked(servers["R7"].port, ca)
    with pytest.raises((OSError, HTTPException)):
        urllib.request.urlopen(f"http://127.0.0.1:{servers['R7'].port}/metrics", timeout=10)
    for server in servers.values():
        server.close()


def shown(port: int) -> str:
    """The certificate that a server shows."""
    return ssl.get_server_certificate(("127.0.0.1", port), timeout=10)


def asked(port: int, ca: str) -> bytes:
    """The metrics at a port, of who can show a certificate of an authority."""
    context = ssl.create_default_context(cafile=ca)
    with (
        socket.create_connection(("127.0.0.1", port), timeout=10) as plain,
        context.wrap_socket(plain, server_hostname=SERVER_NAME) as connection,
    ):
        connection.sendall(b"GET /metrics HTTP/1.0\r\nHost: localhost\r\n\r\n")
        return b"".join(iter(lambda: connection.recv(65536), b""))
