"""A world by one file: registry, command line, messages and help follow by themselves."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.support.yard_world import add_yard


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    return add_yard(tmp_path_factory.mktemp("yard"))


def said(environment: dict[str, str], *command: str, **settings: str) -> tuple[int, str]:
    done = subprocess.run(
        [sys.executable, "-m", *command],
        env=environment | settings,
        capture_output=True,
        text=True,
    )
    return done.returncode, " ".join((done.stdout + done.stderr).split())


@pytest.mark.stumble("a world by one file needs changes elsewhere", command="make up WORLD=yard")
@pytest.mark.parametrize(
    ("command", "words"),
    [
        (("coadapt.main", "up", "--help"), "road,scans,yard}"),
        (("coadapt.main", "up", "--world", "moon"), "'scans', 'yard'"),
        (("coadapt.main", "worlds"), "yard simulated"),
        (("coadapt.main", "picture", "moon", "--output", "x.svg"), "scans, yard"),
    ],
)
def test_the_command_line_names_it(
    environment: dict[str, str], command: tuple[str, ...], words: str
) -> None:
    assert words in said(environment, *command)[1]


def test_processes_and_swarms_know_it(environment: dict[str, str]) -> None:
    status, words = said(environment, "robot_agent", COADAPT_WORLD="moon", COADAPT_ROBOTS="north")
    assert (status, "road, ros2, scans, yard" in words) == (1, True)
    code = "from deploy.spec import make_spec; print(make_spec(robots=('north', 'south'), world="
    done = subprocess.run(
        [sys.executable, "-c", code + "'yard').world)"], env=environment, capture_output=True
    )
    assert done.stdout.decode().strip() == "yard"
    status, words = said(environment, "ego_agent", COADAPT_WORLD="yard", COADAPT_EGO="R1")
    assert (status, "allowed: north, south" in words) == (1, True)
