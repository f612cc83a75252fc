"""The alert rules that a swarm's Prometheus loads: valid, tested each, and told to operators."""

from __future__ import annotations

import contextlib
import json
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from coadapt.main import main
from deploy.dashboards import ALERTS
from deploy.docker import compose
from deploy.prometheus import Prometheus
from deploy.roster import Service
from deploy.scraping import prometheus_config
from deploy.spec import make_spec
from deploy.state import State, write_state
from swarm.errors import DeployError
from tests.support.deploy_support import await_
from tests.support.free_ports import free_port
from tests.support.paths import REPOSITORY

CASES = Path(__file__).with_name("alert_cases.yml")


def rules() -> list[dict[str, Any]]:
    (group,) = yaml.safe_load(ALERTS.read_text())["groups"]
    found: list[dict[str, Any]] = group["rules"]
    return found


def promtool(*arguments: str) -> None:
    if shutil.which("promtool") is None:
        pytest.skip("no promtool: install Debian's package prometheus")
    done = subprocess.run(["promtool", *arguments], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_rules_are_valid() -> None:
    promtool("check", "rules", str(ALERTS))


def test_every_alert_fires_when_it_must_and_only_then() -> None:
    promtool("test", "rules", str(CASES))


def test_every_alert_has_a_case_in_which_it_fires_and_one_in_which_it_must_not() -> None:
    fires: set[str] = set()
    quiet: set[str] = set()
    for group in yaml.safe_load(CASES.read_text())["tests"]:
        for case in group["alert_rule_test"]:
            (fires if case["exp_alerts"] else quiet).add(case["alertname"])
    assert fires == quiet == {rule["alert"] for rule in rules()}


def test_every_alert_waits_and_says_how_bad_it_is_and_where_to_read_on() -> None:
    page = (REPOSITORY / "docs" / "dashboards.md").read_text()
    for rule in rules():
        assert set(rule["annotations"]) == {"summary", "description", "docs"}, rule["alert"]
        assert rule["labels"]["severity"] in ("critical", "warning")
        assert rule["for"] != "0s"
        assert rule["annotations"]["docs"] == "docs/dashboards.md#alerts"
        assert f"| `{rule['alert']}` |" in page
    assert "## Alerts" in page


def test_the_image_has_the_rules_where_its_prometheus_looks_for_them() -> None:
    spec = make_spec(swarm="s", robots=("R1", "R2"), runtime="docker")
    (path,) = yaml.safe_load(compose.prometheus_file(spec))["rule_files"]
    dockerfile = (REPOSITORY / "deploy" / "docker" / "Dockerfile").read_text()
    assert "COPY source /app" in dockerfile
    assert REPOSITORY / Path(path).relative_to("/app") == ALERTS


@pytest.fixture
def server(tmp_path: Path) -> Iterator[str]:
    """A Prometheus as a swarm has it, whose router does not answer; its alerts do not wait."""
    if shutil.which("prometheus") is None:
        pytest.skip("no prometheus: install Debian's package")
    hasty = tmp_path / "alerts.yml"
    waiting = yaml.safe_load(ALERTS.read_text())
    for rule in waiting["groups"][0]["rules"]:
        rule["for"] = "0s"
    hasty.write_text(yaml.safe_dump(waiting))
    router = Service(name="router", role="router", host="infra", argv=(), metrics_port=free_port())
    config = tmp_path / "prometheus.yml"
    config.write_text(prometheus_config([router], lambda _: "127.0.0.1", str(hasty)))
    port = free_port()
    with subprocess.Popen(
        [
            "prometheus",
            f"--config.file={config}",
            f"--storage.tsdb.path={tmp_path / 'data'}",
            f"--web.listen-address=127.0.0.1:{port}",
        ],
        stderr=subprocess.DEVNULL,
    ) as process:
        yield f"http://127.0.0.1:{port}"
        process.terminate()


def test_a_proxy_is_not_asked_and_a_refusal_is_told(
    server: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("http_proxy", "http://127.0.0.1:9")
    prometheus = Prometheus(server)

    def answers() -> bool:
        with contextlib.suppress(DeployError):
            return prometheus.query("vector(1)")[0].value == 1.0
        return False

    await_(answers, "Prometheus answers")
    with pytest.raises(DeployError, match=r"Prometheus refused http://127.*query=1%2B.*bad_data"):
        prometheus.query("1+")
    with pytest.raises(DeployError, match=r"Prometheus at http://127\S+ does not answer"):
        Prometheus(f"http://127.0.0.1:{free_port()}").targets()


def test_metrics_tells_what_fires(
    server: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("COADAPT_RUN_DIR", str(tmp_path))
    spec = make_spec(swarm="s", robots=("R1", "R2"))
    Path(spec.run_dir).mkdir()
    write_state(State(runtime="netns", spec=spec, router="x", prometheus_url=server))

    def shown() -> str:
        return capsys.readouterr().out if main(["metrics", "--swarm", "s"]) == 0 else ""

    await_(
        lambda: "  critical ProcessDown: router does not answer. Prometheus has not" in shown(),
        "the alert fires",
    )
    assert main(["metrics", "--swarm", "s", "--json"]) == 0
    (alert,) = json.loads(capsys.readouterr().out)["alerts"]
    assert (alert["name"], alert["severity"]) == ("ProcessDown", "critical")
    assert [a.name for a in Prometheus(server).alerts()] == ["ProcessDown"]
    monkeypatch.setattr(Prometheus, "alerts", lambda _: ())
    assert "alerts: none" in shown()
