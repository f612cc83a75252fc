"""`coadapt stack` and `coadapt kubernetes`, as a user types them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from coadapt.main import main
from deploy.cluster import charts
from deploy.cluster.plan import IMAGE

ALWAYS = ("--robots", "3", "--rings", "16", "--no-prometheus")
STACK = ("stack", *ALWAYS, "--image", "r:5000/edge:1", "--router", "10.0.0.1")
KUBERNETES = ("kubernetes", *ALWAYS, "--image", "r:5000/edge:1")


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory whose `var/` is this test's."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_stack_is_printed_and_the_same_whenever_it_is_asked_for(
    capsys: pytest.CaptureFixture[str], here: Path
) -> None:
    assert main(STACK) == 0
    first = capsys.readouterr()
    assert "new certificates for router, R1, R2, R3, ego-R1, console, operator-" in first.err
    document: dict[str, Any] = yaml.safe_load(first.out)
    assert list(document["services"]) == [
        *("router", "robot-R1", "robot-R2", "robot-R3", "ego-R1", "console")
    ]
    for one in document["secrets"].values():
        assert Path(one["file"]).is_relative_to(here / "var" / "local" / "keystore")
    assert main(STACK) == 0
    again = capsys.readouterr()
    assert again.out == first.out, "nothing starts anew because a stack is deployed twice"
    assert again.err == ""


def test_the_names_of_the_processes_can_be_had_one_by_one(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main((*STACK, "--list")) == 0
    names = capsys.readouterr().out.split()
    assert main((*STACK, "--only", names[-1])) == 0
    assert list(yaml.safe_load(capsys.readouterr().out)["services"]) == names[-1:]


def test_another_router_address_stands_in_its_certificate(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(STACK) == 0
    before = yaml.safe_load(capsys.readouterr().out)["secrets"]
    assert main((*STACK, "--router", "10.0.0.2")) == 0
    told = capsys.readouterr()
    assert "new certificates for router:" in told.err
    after = yaml.safe_load(told.out)["secrets"]
    changed = {key for key in after if after[key] != before[key]}
    assert changed == {"router-cert.pem", "router-key.pem"}


def test_a_mesh_is_of_the_nodes_own_network_and_takes_an_engine_that_knows_them(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert main((*STACK, "--mesh", "--network", "overlay", "--no-console")) == 1
    assert "--mesh needs --network host, not overlay" in capsys.readouterr().err
    monkeypatch.setenv("DOCKER_HOST", f"unix://{tmp_path}/nobody.sock")
    assert main((*STACK, "--mesh")) == 1
    assert "docker node ls: " in capsys.readouterr().err


def test_an_image_may_be_a_setting(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    words = [word for word in STACK if word not in ("--image", "r:5000/edge:1")]
    assert main(words) == 1
    assert "name it by --image or COADAPT_IMAGE" in capsys.readouterr().err
    monkeypatch.setenv(IMAGE, "r:5000/edge:2")
    assert main(words) == 0
    services = yaml.safe_load(capsys.readouterr().out)["services"]
    assert {one["image"] for one in services.values()} == {"r:5000/edge:2"}
    assert not any(IMAGE in one["environment"] for one in services.values())


def test_a_link_is_shaped_where_the_interface_is_named_that_leads_there(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main((*STACK, "--link", "5mbit")) == 1
    assert "--link shapes the link of the ego's node: name the interface" in capsys.readouterr().err
    assert main((*STACK, "--link", "5mbit", "--interface", "eth1")) == 0
    services = yaml.safe_load(capsys.readouterr().out)["services"]
    assert services["controller-R1"]["environment"]["COADAPT_LINK_BPS"] == "5000000"


def test_what_is_wrong_with_the_roster_is_said_as_up_says_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main((*STACK, "--q-min", "2")) == 1
    assert "--q-min 2.0 is not valid" in capsys.readouterr().err


def test_kubernetes_gets_objects_and_secrets_apart(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert main((*KUBERNETES, "--secrets")) == 0
    secrets = list(yaml.safe_load_all(capsys.readouterr().out))
    assert {one["kind"] for one in secrets} == {"Secret"}
    assert main(KUBERNETES) == 0
    out = capsys.readouterr().out
    assert "Secret" not in {one["kind"] for one in yaml.safe_load_all(out)}
    assert main((*KUBERNETES, "--output", str(tmp_path / "k"))) == 0
    folders = [Path(line) for line in capsys.readouterr().out.split()]
    assert folders == [tmp_path / "k" / charts.BASE, tmp_path / "k" / charts.CHART]
    assert all(folder.is_dir() for folder in folders)
    text = "".join(file.read_text() for one in folders for file in one.rglob("*.yaml"))
    assert "secretName: identity-r1" in text
    assert "key.pem" not in text
