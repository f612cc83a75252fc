"""A swarm's specification is checked at once, and its services follow from it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from coadapt.main import main
from deploy.netns import network
from deploy.rates import format_rate, parse_rate
from deploy.roster import INFRA, Place
from deploy.scraping import prometheus_config
from deploy.services import services
from deploy.spec import SwarmSpec, factory_robots, make_spec
from deploy.state import State, need_state, read_state, remove_run_dir, write_state
from ego_agent.settings import EgoSettings
from llm_gateway.settings import GatewaySettings
from swarm.errors import DeployError
from swarm.process import ProcessSettings
from swarm.settings import load
from swarm.zenoh_config import client_config

PLACE = Place(
    listen_host="10.77.0.1",
    router_host="10.77.0.1",
    var_dir="/var/swarm",
    prometheus_config="/run/prometheus.yml",
    unix_socket="/run/router.sock",
)


def spec_of(**values: Any) -> SwarmSpec:
    return make_spec(**({"robots": factory_robots(3), "run_dir": "/r", "var_dir": "/v"} | values))


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"robots": ("R1",)}, "robots"),
        ({"robots": ("R1", "R1")}, "different"),
        ({"robots": ("R1", "R/2")}, "letters"),
        ({"robots": factory_robots(1001)}, "1000"),
        ({"ego": "R9"}, "'R9' is not one of the robots R1, R2, R3"),
        ({"swarm": "a b"}, "swarm = 'a b'"),
        ({"rings": 17}, "16, 32, 64"),
        ({"period_s": 0.0}, "seconds >= 0.05 and <= 3600"),
        ({"period_s": float("nan")}, "period_s = nan"),
        ({"q_min": 1.5}, "a number >= 0 and <= 1"),
        ({"prometheus_port": 70000}, "a port >= 1 and <= 65532"),
        ({"link_bps": 5}, "bit/s >= 32000"),
        ({"world": "opv2v"}, "data = ''"),
        ({"world": "bag"}, "data = ''"),
        ({"world": "recording", "data": "/tmp"}, "data = '/tmp'"),
        ({"world": "opv2v", "data": "/no/such/place"}, "data = '/no/such/place'"),
        ({"policy": "Rules!"}, "policy = 'Rules!'"),
        ({"llm": "embeded"}, "embedded, or http"),
        ({"llm": "ftp://host/v1"}, "llm = 'ftp://host/v1'"),
        ({"llm": "http://user@host/v1"}, "llm = 'http://user@host/v1'"),
        ({"llm": "http://:80/v1"}, "llm = 'http://:80/v1'"),
        ({"llm": "http://host:eighty/v1"}, "llm = 'http://host:eighty/v1'"),
        ({"llm_model": "m" * 201}, "of length <= 200"),
        ({"colour": "red"}, "colour is not a property"),
    ],
)
def test_a_wrong_property_is_named_with_its_value_and_what_is_allowed(
    values: dict[str, Any], words: str
) -> None:
    with pytest.raises(DeployError, match=words.replace("(", r"\(")):
        spec_of(**values)


def test_the_ego_is_the_first_robot_unless_told_otherwise() -> None:
    assert spec_of().ego == "R1"
    assert spec_of(ego="R3").ego == "R3"


@pytest.mark.parametrize(
    ("llm", "server"),
    [
        ("", None),
        ("embedded", None),
        ("http://gpu:8000/v1", ("gpu", 8000)),
        ("https://api.example.com/v1", ("api.example.com", 443)),
        ("http://[::1]/v1", ("::1", 80)),
    ],
)
def test_the_address_of_a_model_server_follows_from_its_url(
    llm: str, server: tuple[str, int] | None
) -> None:
    assert spec_of(llm=llm).llm_server() == server


def test_a_gateway_runs_where_a_language_model_is_asked_for() -> None:
    assert not [s for s in services(spec_of(), PLACE) if s.role == "gateway"]
    embedded = spec_of(llm="embedded", llm_model="smollm2-135m")
    (gateway,) = [s for s in services(embedded, PLACE) if s.role == "gateway"]
    settings = load(GatewaySettings, gateway.env)
    assert (settings.llm_backend, settings.llm_model) == ("llamacpp", "smollm2-135m")
    (gateway,) = [
        s for s in services(spec_of(llm="http://gpu:8000/v1"), PLACE) if s.role == "gateway"
    ]
    settings = load(GatewaySettings, gateway.env)
    assert (settings.llm_backend, settings.llm_url) == ("openai", "http://gpu:8000/v1")


@pytest.mark.parametrize(
    ("llm", "model", "trained"),
    [
        ("embedded", "", True),
        ("embedded", "smollm2-135m", False),
        ("http://gpu:8000/v1", "", False),
        ("", "", False),
    ],
)
def test_the_packages_own_model_decides_as_it_was_trained(
    llm: str, model: str, trained: bool
) -> None:
    members = services(spec_of(llm=llm, llm_model=model), PLACE)
    (ego,) = [s for s in members if s.role == "ego"]
    assert load(EgoSettings, ego.env).llm_prompt == ("short" if trained else "table")
    for gateway in (s for s in members if s.role == "gateway"):
        assert load(GatewaySettings, gateway.env).llm_trained is trained


def test_two_starts_of_one_swarm_are_the_same_specification() -> None:
    assert spec_of(epoch_ns=1).same_as(spec_of(epoch_ns=2))
    assert spec_of().differences(spec_of(rings=64, policy="rules")) == ("rings", "policy")


def test_every_process_is_there_once_and_the_ego_shares_its_robots_host() -> None:
    members = services(spec_of(ego="R2"), PLACE)
    assert [s.name for s in members] == [
        *("router", "controller", "robot-R1", "robot-R2", "robot-R3"),
        *("ego-R2", "prometheus"),
    ]
    hosts = {s.name: s.host for s in members}
    assert hosts["ego-R2"] == hosts["robot-R2"] == "R2"
    assert hosts["router"] == hosts["prometheus"] == INFRA
    assert "prometheus" not in {s.name for s in services(spec_of(prometheus=False), PLACE)}


def test_processes_get_settings_that_they_accept() -> None:
    spec = spec_of(rings=16, seed=7, swarm="hall")
    for service in services(spec, PLACE):
        if service.role in ("robot", "ego"):
            settings = load(ProcessSettings, service.env)
            assert settings.swarm == "hall"
            assert settings.world_robots == 3
            assert settings.world_rings == 16
            assert settings.metrics_port == service.metrics_port
            assert client_config(settings.router)["mode"] == "client"


def test_prometheus_scrapes_every_process_with_its_role_and_robot() -> None:
    members = services(spec_of(), PLACE)
    config = yaml.safe_load(prometheus_config(members, lambda s: s.host, "/alerts.yml"))
    assert config["global"]["scrape_interval"] == "2s"
    assert config["rule_files"] == ["/alerts.yml"]
    found = {
        static["labels"]["instance"]: (job["job_name"], static["labels"].get("robot"))
        for job in config["scrape_configs"]
        for static in job["static_configs"]
    }
    assert found == {
        "router": ("router", None),
        "controller": ("controller", None),
        "robot-R1": ("robot", "R1"),
        "robot-R2": ("robot", "R2"),
        "robot-R3": ("robot", "R3"),
        "ego-R1": ("ego", "R1"),
        "prometheus": ("prometheus", None),
    }
    targets = [
        t for j in config["scrape_configs"] for s in j["static_configs"] for t in s["targets"]
    ]
    assert len(set(targets)) == len(members)


@given(count=st.integers(2, 300))
def test_hosts_have_addresses_of_their_own(count: int) -> None:
    spec = spec_of(robots=factory_robots(count))
    hosts = [INFRA, *spec.robots]
    assert len({network.address(spec, host) for host in hosts}) == len(hosts)
    assert all(len(network.link_name(spec, robot)) <= 15 for robot in spec.robots)


def test_an_unknown_host_is_named() -> None:
    with pytest.raises(DeployError, match="'R9' is not one of infra, R1, R2, R3"):
        network.address(spec_of(), "R9")


@pytest.mark.parametrize(
    ("text", "bps"), [("55mbit", 55_000_000), ("5.5Mbit", 5_500_000), ("800kbit", 800_000)]
)
def test_rates_are_read_as_people_write_them(text: str, bps: int) -> None:
    assert parse_rate(text) == bps


@pytest.mark.parametrize("text", ["", "5", "5 mb", "-5mbit", "5mbit/s", "nanmbit"])
def test_other_rates_are_refused_with_an_example(text: str) -> None:
    with pytest.raises(DeployError, match="55mbit"):
        parse_rate(text)


def test_rates_are_shown_in_a_readable_unit() -> None:
    assert format_rate(55e6) == "55.0 Mbit/s"
    assert format_rate(800) == "800 bit/s"


def test_the_record_of_a_swarm_comes_back_as_it_was_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COADAPT_RUN_DIR", str(tmp_path))
    spec = make_spec(swarm="s1", robots=("R1", "R2"))
    Path(spec.run_dir).mkdir()
    state = State(runtime="netns", spec=spec, router="unixsock-stream//x")
    write_state(state)
    assert read_state("s1") == state
    assert remove_run_dir("s1")
    assert not remove_run_dir("s1")
    with pytest.raises(DeployError, match="no swarm 's1' is running"):
        need_state("s1")


def test_a_broken_record_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COADAPT_RUN_DIR", str(tmp_path))
    (tmp_path / "s1").mkdir()
    (tmp_path / "s1" / "state.json").write_text('{"runtime": "ne')
    with pytest.raises(DeployError, match=r"state\.json of .* run `make down SWARM=s1`"):
        read_state("s1")


@pytest.mark.parametrize("command", ["down", "status", "up"])
def test_a_name_that_leads_out_of_the_run_directory_is_refused(
    command: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    base = tmp_path / "base"
    (tmp_path / "mine").mkdir()
    monkeypatch.setenv("COADAPT_RUN_DIR", str(base))
    assert main([command, "--swarm", "../mine"]) == 1
    assert "swarm name '../mine' is not allowed" in capsys.readouterr().err
    assert (tmp_path / "mine").exists()


def test_many_robots_say_in_which_cell_they_are() -> None:
    few, many = (make_spec(robots=factory_robots(count)) for count in (64, 65))
    assert (few.areas, many.areas) == (False, True)
    assert not make_spec(robots=factory_robots(65), areas=False).areas


def test_robots_and_egos_of_a_large_site_are_told_to_use_cells(tmp_path: Path) -> None:
    for count, told in ((3, None), (70, "1")):
        spec = spec_of(robots=factory_robots(count), ego_standby="R2")
        found = {one.role: one.env.get("COADAPT_AREAS") for one in services(spec, PLACE)}
        assert found["robot"] == found["ego"] == told
        assert found["router"] is None
