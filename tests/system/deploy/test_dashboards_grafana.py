"""Grafana's dashboards ask for what the project's processes say, and its container shows them to
the host alone."""

from __future__ import annotations

import json
import re
import shutil
import stat
import subprocess
import tomllib
import urllib.request
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
import yaml
from prometheus_client import CollectorRegistry
from prometheus_client.parser import text_string_to_metric_families

from coadapt.main import main
from deploy import ports
from deploy.dashboards import ALERTS, GRAFANA
from deploy.docker import compose, grafana
from deploy.spec import SwarmSpec, make_spec
from deploy.trust.metrics import AuthorityMetrics
from ego_agent.metrics import EgoMetrics
from llm_gateway.http_app import make_app
from llm_gateway.metrics import GatewayMetrics
from network_controller.metrics import ControllerMetrics
from network_controller.qod.metrics import QodMetrics
from robot_agent.metrics import RobotMetrics
from swarm.errors import DeployError
from swarm.http.access import Access
from swarm.log import make_logger
from swarm.metrics import show_free_disk
from swarm.router import serve_metrics
from swarm.tcp.peers import PeerTraffic
from tests.support.paths import REPOSITORY

SCHEMA = 42
"""Of the dashboards that Grafana 12.2 and 12.3 write."""
TARGET_LABELS = {"role", "instance", "robot", "job"}
OTHERS = {
    "up": set(),
    "ALERTS": {"alertname", "alertstate", "severity", "traffic"},
    # Every session counts it, once it is connected: the session's own tests hold the name.
    "coadapt_messages_invalid_total": {"kind"},
    # Of a secure router: `tests/swarm/swarm/test_trust.py` reads it.
    "coadapt_router_refused_links_total": set(),
    # Once fusion has gone to some host: `tests/unit/swarm/test_tcp_peers.py` reads them.
    "coadapt_router_peer_sent_bytes_total": {"peer"},
    "coadapt_router_peer_stood_seconds_total": {"peer"},
}
UNTOLD = {"titleFormat", "textFormat", "step", "definition"}
"""Keys of Prometheus' annotations and variables, which the schema leaves to its plugin."""
# Okabe and Ito's colours, which the colour-blind tell apart, and greys.
PALETTE = {"#0072B2", "#E69F00", "#56B4E9", "#009E73", "#D55E00", "#CC79A7", "#999999"}
FILES = sorted(GRAFANA.glob("*.json"))


def dashboards() -> list[dict[str, Any]]:
    return [json.loads(path.read_text()) for path in FILES]


def panels() -> list[tuple[str, dict[str, Any]]]:
    """Every panel that shows something, with where it is."""
    return [
        (f"{board['title']}: {panel['title']}", panel)
        for board in dashboards()
        for panel in board["panels"]
        if panel["type"] != "row"
    ]


def queries() -> list[tuple[str, str, str]]:
    """Where, expression and legend of everything that a dashboard asks Prometheus."""
    found = [(w, t["expr"], t["legendFormat"]) for w, p in panels() for t in p["targets"]]
    for board in dashboards():
        for note in board["annotations"]["list"]:
            found.append((board["title"], note["expr"], note["titleFormat"] + note["textFormat"]))
    return found


def plain(expression: str) -> str:
    """PromQL without Grafana's variables."""
    return re.sub(r"\$(robot|direction)\b", ".*", expression).replace("$__rate_interval", "1m")


def metrics() -> dict[str, set[str]]:
    """The series that the processes serve, with their labels."""
    registry = CollectorRegistry()
    for of_process in (RobotMetrics, EgoMetrics, ControllerMetrics, QodMetrics, GatewayMetrics):
        of_process(registry)
    AuthorityMetrics(registry, life_s=60)
    show_free_disk(registry, Path("journal.jsonl"))
    log = make_logger("test", level="critical")
    make_app(cast("Any", None), Access("localhost", ""), registry, log)
    found = dict(OTHERS)
    for collector in set(registry._collector_to_names):
        collected = cast("Any", collector)
        labels = set(collected._labelnames)
        ends = {"counter": ["_total"], "histogram": ["_sum", "_count"]}.get(collected._type, [""])
        found |= {collected._name + end: labels for end in ends}
        if collected._type == "histogram":
            found[collected._name + "_bucket"] = labels | {"le"}
    nothing = SimpleNamespace(connected=lambda: (0, 0), traffic=PeerTraffic())
    with closing(serve_metrics(cast("Any", nothing), "127.0.0.1", 0)) as server:
        url = f"http://127.0.0.1:{server.port}/metrics"
        with urllib.request.urlopen(url, timeout=10) as reply:
            text = reply.read().decode()
    families = list(text_string_to_metric_families(text))
    named = {s.name: set(s.labels) for family in families for s in family.samples}
    return found | {family.name: set() for family in families} | named


NAME = re.compile(r"\b(coadapt_\w+|up|ALERTS)\b(?:\{([^}]*)\})?")
GROUPED = re.compile(r"\b(?:by|on|ignoring|without)\s*\(([^)]*)\)")


def wrong_names(expression: str, legend: str, known: dict[str, set[str]]) -> set[str]:
    """Metrics and labels of a query that no process has."""
    wrong, labels = set(), set(TARGET_LABELS)
    for name, matchers in NAME.findall(GROUPED.sub("", expression)):
        has = known.get(name, set()) | TARGET_LABELS
        labels |= has
        wrong |= {name} - known.keys()
        wrong |= set(re.findall(r'(\w+)\s*(?:=|!)[=~]?"', matchers)) - has
    used = {x.strip() for group in GROUPED.findall(expression) for x in group.split(",")} - {""}
    return wrong | ((used | set(re.findall(r"\{\{\s*(\w+)\s*\}\}", legend))) - labels)


def test_dashboards_and_alerts_ask_only_for_metrics_and_labels_that_there_are() -> None:
    known = metrics()
    for where, expression, legend in queries():
        assert not wrong_names(expression, legend, known), where
    (group,) = yaml.safe_load(ALERTS.read_text())["groups"]
    for rule in group["rules"]:
        assert not wrong_names(rule["expr"], "", known), rule["alert"]
        words = " ".join(rule["annotations"].values())
        assert set(re.findall(r"\bcoadapt_\w+", words)) <= known.keys(), rule["alert"]


@pytest.mark.parametrize(
    ("expression", "legend", "wrong"),
    [
        ("coadapt_ego_capacity_bps", "{{instance}}", set()),
        ("rate(coadapt_ego_cycle_seconds[1m])", "", {"coadapt_ego_cycle_seconds"}),
        ('coadapt_net_level{robot="R1", way="up"}', "", {"way"}),
        ("sum by (colour) (coadapt_net_level)", "", {"colour"}),
        ("coadapt_ego_frames_total", "{{outcome}}", {"outcome"}),
    ],
)
def test_a_name_that_there_is_not_is_found(expression: str, legend: str, wrong: set[str]) -> None:
    assert wrong_names(expression, legend, metrics()) == wrong


def test_every_query_is_valid(tmp_path: Path) -> None:
    if shutil.which("promtool") is None:
        pytest.skip("no promtool: install Debian's package prometheus")
    rules = [
        {"record": f"query:{n}", "expr": plain(expression)}
        for n, (_, expression, _) in enumerate(queries())
    ]
    path = tmp_path / "queries.yml"
    path.write_text(yaml.safe_dump({"groups": [{"name": "queries", "rules": rules}]}))
    done = subprocess.run(["promtool", "check", "rules", str(path)], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert not any("$" in rule["expr"] for rule in rules)


def test_dashboards_can_be_imported_together() -> None:
    boards = dashboards()
    assert [b["uid"] for b in boards] == [
        "coadapt-gateway",
        "coadapt-hosts",
        "coadapt-network",
        "coadapt-swarm",
    ]
    for board in boards:
        assert board["schemaVersion"] == SCHEMA
        assert "id" not in board
        for key in ("id", "title"):
            values = [panel[key] for panel in board["panels"]]
            assert len(set(values)) == len(values), (board["title"], key)
    for where, panel in panels():
        assert panel["datasource"]["uid"] == "${datasource}", where
        unitless = panel["type"] in ("table", "state-timeline")
        assert unitless or panel["fieldConfig"]["defaults"]["unit"], where
        letters = [target["refId"] for target in panel["targets"]]
        assert len(set(letters)) == len(letters), where


def test_every_panel_says_why_it_may_be_empty() -> None:
    for where, panel in panels():
        words = panel["fieldConfig"]["defaults"]["noValue"]
        asked = " ".join(target["expr"] for target in panel["targets"])
        assert words, where
        assert "coadapt_llm_" not in asked or "--llm" in words, where


def test_dashboards_hold_to_grafanas_own_schema() -> None:
    """The models that Grafana's makers generate from it: a key that it does not have is lost. No
    package has Grafana's program, so that it is not started here."""
    pytest.importorskip("grafana_foundation_sdk", reason="run make setup")
    from grafana_foundation_sdk.cog.encoder import JSONEncoder
    from grafana_foundation_sdk.cog.plugins import register_default_plugins
    from grafana_foundation_sdk.models.dashboard import Dashboard

    register_default_plugins()
    for board in dashboards():
        again = json.loads(JSONEncoder().encode(Dashboard.from_json(board)))
        assert lost_keys(board, again) <= UNTOLD, board["title"]
        board["panels"][0]["colour"] = "red"
        again = json.loads(JSONEncoder().encode(Dashboard.from_json(board)))
        assert "colour" in lost_keys(board, again)


def lost_keys(one: Any, other: Any) -> set[str]:
    """The keys of JSON whose value another lacks, or has otherwise."""
    if isinstance(one, dict) and isinstance(other, dict):
        found = {key for key in one if key not in other}
        return found.union(*(lost_keys(one[key], other[key]) for key in one.keys() & other.keys()))
    if isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        return set().union(*(lost_keys(a, b) for a, b in zip(one, other, strict=True)))
    return set() if one == other else {repr(one)}


def test_panels_fill_the_width_and_cover_no_other() -> None:
    for board in dashboards():
        cells: set[tuple[int, int]] = set()
        for panel in board["panels"]:
            at = panel["gridPos"]
            rows, columns = range(at["y"], at["y"] + at["h"]), range(at["x"], at["x"] + at["w"])
            covered = {(y, x) for y in rows for x in columns}
            assert not covered & cells, panel["title"]
            cells |= covered
        assert cells == {(y, x) for y in range(len(cells) // 24) for x in range(24)}


def test_colours_can_be_told_apart_by_the_colour_blind() -> None:
    for path in FILES:
        text = path.read_text()
        assert set(re.findall(r'"(#\w+)"', text)) <= PALETTE
        names = set(re.findall(r'"(?:color|fixedColor|iconColor)": "(\w+)"', text))
        assert names <= {"transparent"}, path.name


def test_thresholds_are_those_of_the_alerts_and_alerts_name_panels_that_there_are() -> None:
    (group,) = yaml.safe_load(ALERTS.read_text())["groups"]
    shown = {panel["title"]: panel for _, panel in panels()}
    limits = {rule["alert"]: rule["expr"].split()[-1] for rule in group["rules"]}
    for title, alert in {
        "Used of C(t)": "TrafficInfeasible",
        "Planned of C(t)": "TrafficInfeasible",
        "Q_min out of reach for": "QualityOutOfReach",
        "Below Q_min because of the link": "QualityOutOfReach",
        "Cycles missed": "CyclesMissed",
    }.items():
        worst = shown[title]["fieldConfig"]["defaults"]["thresholds"]["steps"][-1]["value"]
        assert worst == float(limits[alert]), title
    words = " ".join(rule["annotations"]["description"] for rule in group["rules"])
    named = set(re.findall(r'[Pp]anel "([^"]+)"', words))
    assert named
    assert named <= shown.keys()


def test_the_package_ships_every_file() -> None:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())
    data = project["tool"]["setuptools"]["package-data"]
    shipped = {p for g in data["*"] + data["deploy.dashboards"] for p in GRAFANA.parent.glob(g)}
    files = {p for p in GRAFANA.parent.rglob("*") if p.is_file() and "__pycache__" not in p.parts}
    assert {p for p in files if p.suffix != ".py"} <= shipped


def spec_of(tmp_path: Path, **values: Any) -> SwarmSpec:
    paths = {"run_dir": str(tmp_path / "run"), "var_dir": str(tmp_path / "var")}
    return make_spec(**({"robots": ("R1", "R2"), "runtime": "docker"} | paths | values))


def composed(spec: SwarmSpec) -> str:
    return compose.compose_file(spec, "image:tag", "llm:tag", "172.17.0.1")


def test_grafana_is_there_only_where_it_is_asked_for(tmp_path: Path) -> None:
    assert "grafana" not in yaml.safe_load(composed(spec_of(tmp_path)))["services"]
    spec = spec_of(tmp_path, grafana=True, grafana_port=3456)
    one = yaml.safe_load(composed(spec))["services"]["grafana"]
    assert re.fullmatch(r"grafana/grafana:\d+\.\d+\.\d+@sha256:[0-9a-f]{64}", one["image"])
    assert one["ports"] == ["127.0.0.1:3456:3000"]
    assert one["networks"] == ["swarm"]
    assert one["cap_drop"] == ["ALL"]
    assert "command" not in one
    assert all(volume.endswith(":ro") for volume in one["volumes"])
    assert "grafana_port" in {use.field for use in ports.ports_of(spec)}
    assert "grafana" not in compose.prometheus_file(spec)


def test_anybody_may_look_and_only_who_knows_the_made_password_may_more(tmp_path: Path) -> None:
    settings = grafana.container(spec_of(tmp_path, grafana=True))["environment"]
    assert settings["GF_AUTH_ANONYMOUS_ENABLED"] == "true"
    assert settings["GF_AUTH_ANONYMOUS_ORG_ROLE"] == "Viewer"
    assert "GF_SECURITY_ADMIN_PASSWORD" not in settings
    grafana.write_password(tmp_path)
    path = tmp_path / grafana.PASSWORD_FILE
    first = path.read_text()
    assert len(first) >= 32
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    grafana.write_password(tmp_path)
    assert path.read_text() != first


def test_grafana_finds_the_files_where_they_are_mounted(tmp_path: Path) -> None:
    one = grafana.container(spec_of(tmp_path, grafana=True))
    settings = one["environment"]
    source, target, _ = one["volumes"][0].split(":")

    def on_host(path: str) -> Path:
        return Path(source, Path(path).relative_to(target))

    assert on_host(settings["GF_DASHBOARDS_DEFAULT_HOME_DASHBOARD_PATH"]) in FILES
    assert list(on_host(settings["COADAPT_DASHBOARDS"]).glob("*.json"))
    provisioning = on_host(settings["GF_PATHS_PROVISIONING"])
    for path in provisioning.glob("*/*.yml"):
        names = re.findall(r"\$\{(\w+)\}", path.read_text())
        assert names
        assert set(names) <= settings.keys()
    (provider,) = yaml.safe_load((provisioning / "dashboards/coadapt.yml").read_text())["providers"]
    assert not provider["allowUiUpdates"]
    (source_,) = yaml.safe_load((provisioning / "datasources/prometheus.yml").read_text())[
        "datasources"
    ]
    assert (source_["type"], source_["isDefault"]) == ("prometheus", True)


def test_another_image_may_be_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COADAPT_GRAFANA_IMAGE", "mirror/grafana:1")
    services = yaml.safe_load(composed(spec_of(tmp_path, grafana=True)))["services"]
    assert services["grafana"]["image"] == "mirror/grafana:1"
    assert "COADAPT_GRAFANA_IMAGE" not in services["ego-R1"]["environment"]


def test_compose_takes_the_file(tmp_path: Path) -> None:
    command = compose.compose_command()
    if command is None:
        pytest.skip("no compose: install docker-compose or Docker's compose plugin")
    file = tmp_path / "compose.yml"
    file.write_text(composed(spec_of(tmp_path, grafana=True, llm="http://h:1/v1")))
    done = subprocess.run(
        [*command, "--file", str(file), "config"], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    assert "127.0.0.1:3000:3000" in done.stdout or "host_ip: 127.0.0.1" in done.stdout


def test_grafana_in_namespaces_is_refused_with_what_helps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(DeployError, match=r"needs the Docker runtime.*netns; docs/dashboards\.md"):
        spec_of(tmp_path, runtime="netns", grafana=True)
    with pytest.raises(DeployError, match="leave out --no-prometheus"):
        spec_of(tmp_path, grafana=True, prometheus=False)
    monkeypatch.setenv("COADAPT_RUN_DIR", str(tmp_path))
    assert main(["up", "--runtime", "netns", "--grafana", "--swarm", "g"]) == 1
    assert "netns" in capsys.readouterr().err
