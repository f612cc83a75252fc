"""What `coadapt join`, `router` and `--router` make of what is typed, before anything starts."""

from __future__ import annotations

import configparser
import shlex
from pathlib import Path
from typing import Any

import pytest

from coadapt import elsewhere
from coadapt.joining import Wish, needs_ego, router_of, settings_of, swarm_of
from coadapt.main import main
from swarm.errors import CoAdaptError, IdentityError, SettingError
from tests.support.secure_swarm import made_keystore

LEARNT = {"world": "factory", "epoch_ns": "5", "world_robots": "6", "world_seed": "3"}


@pytest.fixture(scope="module")
def issued(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Identities of a swarm called `floor`."""
    store = made_keystore(
        tmp_path_factory.mktemp("keys"), "floor", "R2", "ego-R1", "operator-ann", "reader-bob"
    )
    return store.folder / "issued"


def wish(place: str, robot: str = "R2", cert: Path | None = None, **settings: object) -> Wish:
    return Wish(place, robot, cert, None, settings)


def test_the_usual_port_and_the_robots_folder_go_without_saying(issued: Path) -> None:
    assert router_of(wish("tcp/h")) == "tcp/h:7447"
    own = f"tls/h:7447#identity={issued / 'R2'}"
    assert router_of(wish("tls/h", cert=issued)) == own
    assert router_of(wish("tls/h:7447", cert=issued / "R2")) == own
    assert swarm_of(own, None) == swarm_of(own, "floor") == "floor"
    assert swarm_of("tcp/h:7447", None) == "local"


@pytest.mark.parametrize(
    ("place", "robot", "cert", "told"),
    [
        ("udp/h", "R2", "", "must be tls/HOST"),
        ("h:7447", "R2", "", "must be tls/HOST"),
        ("tls/h", "R2", "", "wants a certificate: --cert FOLDER"),
        ("tcp/h", "R2", "R2", "tcp/h:7447 is a plain one"),
        ("tls/h", "R3", "R2", "names the identity of 'R2', and this process is 'R3'"),
        ("tls/h", "R3", "R3", "R3.* cannot be read"),
    ],
)
def test_what_cannot_be_is_said_before_anything_starts(
    issued: Path, place: str, robot: str, cert: str, told: str
) -> None:
    with pytest.raises(CoAdaptError, match=told):
        router_of(wish(place, robot, issued / cert if cert else None))


def test_a_certificate_of_another_swarm_is_told(issued: Path) -> None:
    router = f"tls/h:7447#identity={issued / 'R2'}"
    with pytest.raises(SettingError, match=r"--swarm yard is not the swarm .* that is floor"):
        swarm_of(router, "yard")


def test_what_is_not_given_the_ego_tells() -> None:
    assert needs_ego({})
    assert needs_ego({"world": "factory"})
    assert not needs_ego({"world": "factory", "epoch_ns": 5})
    assert not needs_ego({"world": "ros2"})


def test_what_is_typed_goes_before_what_was_learnt() -> None:
    typed = wish("tcp/h", world_seed=9, world_rings=None)
    made = settings_of(typed, "tcp/h:7447", "floor", LEARNT, {"COADAPT_WORKERS": "2"})
    assert (made.world_seed, made.world_robots, made.epoch_ns) == (9, 6, 5)
    assert (made.robots, made.swarm, made.router) == (("R2",), "floor", "tcp/h:7447")
    assert (made.workers, made.world_learnt) == (2, True)
    # Of another world than the ego's only the time holds.
    road = settings_of(wish("tcp/h", world="road"), "tcp/h:7447", "floor", LEARNT, {})
    assert (road.epoch_ns, road.world_seed) == (5, 1)


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"world_robots": 1}, "COADAPT_WORLD_ROBOTS = '1' is not valid"),
        ({"world": "opv2v"}, "world opv2v needs --data"),
        ({"world": "opv2v", "world_data": "/not/there"}, "--data /not/there is not there"),
    ],
)
def test_a_robot_that_could_not_live_in_its_world_is_not_started(
    settings: dict[str, Any], told: str
) -> None:
    with pytest.raises(SettingError, match=told):
        settings_of(wish("tcp/h", **settings), "tcp/h:7447", "floor", LEARNT, {})


def test_a_unit_runs_the_command_that_was_typed(
    issued: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "robot.service"
    typed = ["join", "tls/h", "--robot", "R2", "--cert", str(issued), "--cache", "/c d/50%"]
    assert main([*typed, "--systemd", "--output", str(output)]) == 0
    unit = configparser.ConfigParser(interpolation=None)
    unit.read(output)
    words = shlex.split(unit["Service"]["ExecStart"])
    assert words[1:6] == ["-m", "coadapt.main", "join", "tls/h", "--robot"]
    assert words[words.index("--cert") + 1] == str(issued)
    assert words[words.index("--swarm") + 1] == "floor"
    assert words[words.index("--cache") + 1] == "/c d/50%%"
    assert unit["Service"]["ReadWritePaths"] == '"/c d/50%%"'
    assert unit["Service"]["User"] == (issued / "R2" / "key.pem").owner()
    assert main([*typed, "--systemd"]) == 0
    assert capsys.readouterr().out == output.read_text()


def test_a_plain_router_listens_on_the_loopback_only(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["router", "--listen", "192.0.2.7"]) == 1
    assert "makes it a secure one" in capsys.readouterr().err
    assert main(["router", "--listen", "127.0.0.1", "--peer", "tcp/h", "--systemd"]) == 0
    (line,) = [x for x in capsys.readouterr().out.splitlines() if x.startswith("ExecStart")]
    assert line.endswith("--swarm local --peer tcp/h:7447")


def test_a_router_takes_the_certificate_of_a_router_only(
    issued: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["router", "--listen", "192.0.2.7", "--cert", str(issued / "R2")]) == 1
    assert "is of R2, which is no router" in capsys.readouterr().err


def test_tools_come_as_operators_and_readers(issued: Path) -> None:
    for name in ("operator-ann", "reader-bob"):
        router = elsewhere.router_of(f"tls/h#identity={issued / name}")
        assert router == f"tls/h:7447#identity={issued / name}"
    with pytest.raises(SettingError, match="R2 may not do what this command does"):
        elsewhere.router_of(f"tls/h#identity={issued / 'R2'}")
    with pytest.raises(IdentityError, match="cannot be read"):
        elsewhere.router_of("tls/h#identity=/not/there/operator-ann")
    for text in ("h:7447", "tls/h#key=/x"):
        with pytest.raises(SettingError, match="it must be tls/HOST"):
            elsewhere.router_of(text)


def test_a_router_that_is_no_machine_is_a_sentence(
    issued: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    router = f"tls/no-such-host.invalid#identity={issued / 'reader-bob'}"
    assert main(["status", "--router", router]) == 1
    told = capsys.readouterr().err
    assert "the router at tls/no-such-host.invalid:7447 does not answer" in told
    assert "'no-such-host.invalid' is the name of no machine" in told
