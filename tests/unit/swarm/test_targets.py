"""Where metrics are: what a process tells of itself, and what Prometheus is told of it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from swarm import keyspace
from swarm.announce import PLACE, place_of
from swarm.errors import SettingError
from swarm.log import make_logger
from swarm.process import SwarmSettings
from swarm.settings import load
from swarm.targets import GONE_S, Targets, groups, target_of


def key(role: str, place: str = "http:10.0.0.7:9101") -> str:
    return keyspace.metrics("S", role, place)


@pytest.mark.parametrize(
    ("role", "labels"),
    [
        ("R7", {"role": "robot", "robot": "R7", "instance": "robot-R7", "job": "robot"}),
        ("ego-R1", {"role": "ego", "robot": "R1", "instance": "ego-R1", "job": "ego"}),
        ("controller", {"role": "controller", "instance": "controller"}),
        ("controller-hall-2", {"role": "controller", "instance": "controller-hall-2"}),
        ("router-hall-2", {"role": "router", "instance": "router-hall-2"}),
        ("router", {"role": "router", "instance": "router-10.0.0.7"}),
    ],
)
def test_a_target_is_labelled_as_those_that_the_swarm_was_started_with(
    role: str, labels: dict[str, str]
) -> None:
    target = target_of(key(role))
    assert target is not None
    assert target["targets"] == ["10.0.0.7:9101"]
    assert labels.items() <= target["labels"].items()
    assert target["labels"]["__scheme__"] == "http"
    assert ("robot" in target["labels"]) == (role in ("R7", "ego-R1"))


@pytest.mark.parametrize(
    "wrong",
    [
        key("R7", "ftp:10.0.0.7:9101"),
        key("R7", "http:10.0.0.7"),
        key("R7", "http:10.0.0.7:0"),
        key("R7", "http:10.0.0.7:99999"),
        key("R7", "http:10.0.0.7 evil:91"),
        key("R7", "http:user@10.0.0.7:9101"),
        "coadapt/S/metrics/R!/http:10.0.0.7:9101",
        "coadapt/S/robot/R7/alive",
        "coadapt/S/metrics/R7",
    ],
)
def test_a_key_that_tells_nothing_usable_is_no_target(wrong: str) -> None:
    assert target_of(wrong) is None


def test_of_two_processes_of_one_name_one_is_a_target() -> None:
    both = [key("R7"), key("R7", "http:10.0.0.8:9101"), key("R8")]
    assert [one["targets"] for one in groups(both)] == [["10.0.0.7:9101"], ["10.0.0.7:9101"]]


@pytest.mark.parametrize(
    ("values", "place"),
    [
        ({"COADAPT_METRICS_HOST": "10.0.0.7"}, "http:10.0.0.7:9101"),
        ({"COADAPT_METRICS_HOST": "fd00::7"}, "http:[fd00::7]:9101"),
        ({"COADAPT_METRICS_ADDRESS": "robot7.site"}, "http:robot7.site:9101"),
        ({"COADAPT_METRICS_ADDRESS": "10.1.1.1:80"}, "http:10.1.1.1:80"),
        ({"COADAPT_METRICS_ADDRESS": "[fd00::7]"}, "http:[fd00::7]:9101"),
        ({"COADAPT_METRICS_ADDRESS": "[fd00::7]:80"}, "http:[fd00::7]:80"),
        # On the way to the router.
        ({"COADAPT_METRICS_HOST": "0.0.0.0"}, "http:127.0.0.1:9101"),
        (
            {"COADAPT_METRICS_HOST": "0.0.0.0", "COADAPT_ROUTER": "unixsock-stream//tmp/r"},
            "http:127.0.0.1:9101",
        ),
        # Only from its own host, where the router is as well; else it is not told.
        ({}, "http:127.0.0.1:9101"),
        ({"COADAPT_ROUTER": "tls/10.0.0.1:7447#identity=/k/R7"}, ""),
        (
            {"COADAPT_METRICS_HOST": "0.0.0.0", "COADAPT_ROUTER": "tcp/nowhere.invalid:7447"},
            "",
        ),
    ],
)
def test_a_process_tells_where_others_reach_its_metrics(values: dict[str, str], place: str) -> None:
    found = place_of(load(SwarmSettings, values), 9101)
    assert found == place
    assert not found or PLACE.fullmatch(found)


@pytest.mark.parametrize("address", ["10.0.0.7:x", "a b", "[fd00::7", "http://10.0.0.7"])
def test_a_wrong_address_is_refused(address: str) -> None:
    with pytest.raises(SettingError, match="HOST, HOST:PORT or empty"):
        load(SwarmSettings, {"COADAPT_METRICS_ADDRESS": address})


def test_what_was_written_stays_until_nobody_has_told_of_it_for_a_while(tmp_path: Path) -> None:
    now_s = 10.0
    path = tmp_path / "targets" / "joined.json"
    path.parent.mkdir()
    path.write_text(json.dumps(groups([key("R7")])))
    targets = Targets(path, "S", make_logger("test"), lambda: now_s)
    targets.look()
    assert json.loads(path.read_text()) == groups([key("R7")])
    now_s += GONE_S + 1.0
    targets.look()
    assert json.loads(path.read_text()) == []


@pytest.mark.parametrize("text", ["", "{", "[1]", '[{"labels": {}}]', '{"a": 1}'])
def test_a_file_that_is_no_list_of_targets_is_written_anew(tmp_path: Path, text: str) -> None:
    path = tmp_path / "joined.json"
    path.write_text(text)
    Targets(path, "S", make_logger("test")).look()
    assert json.loads(path.read_text()) == []


def test_a_folder_that_cannot_be_written_ends_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    targets = Targets(tmp_path / "file" / "joined.json", "S", make_logger("test"))
    targets.look()
    targets.look()
