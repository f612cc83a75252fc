"""The built wheel, installed into an empty environment, away from any checkout.

What the wheel depends on is lent by the environment of the tests (PyTorch alone has 200 MB): all of
it, or only what the wheel brings without an extra.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import tomllib
import venv
import zipfile
from collections.abc import Callable, Iterator
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from deploy.netns import launch
from tests.support import ego_swarm
from tests.support.deploy_support import await_
from tests.support.free_ports import free_port
from tests.support.paths import REPOSITORY

READY_S = 120.0
BUILD_S = 240.0
SWARM = ("--swarm", "wheel")
SOURCES = ("pyproject.toml", "setup.py")
PIP = (sys.executable, "-m", "pip")
OFFLINE = ("--quiet", "--no-deps", "--no-index")

Run = Callable[..., subprocess.CompletedProcess[str]]


def clean() -> dict[str, str]:
    """The environment without what would lead to a checkout or to data."""
    own = {"PYTHONPATH", "VIRTUAL_ENV", "COADAPT_DATA"}
    return {name: value for name, value in os.environ.items() if name not in own}


def checked(command: list[str], cwd: Path) -> None:
    done = subprocess.run(
        command, cwd=cwd, env=clean(), capture_output=True, text=True, timeout=BUILD_S
    )
    assert done.returncode == 0, done.stdout + done.stderr


def needed(wanted: list[str]) -> set[str]:
    """The distributions that requirements bring without an extra, found in this environment."""
    found: set[str] = set()
    left = [Requirement(text) for text in wanted]
    while left:
        requirement = left.pop()
        if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
            name = requirement.name.lower()
            if name not in found:
                left += [Requirement(text) for text in metadata.requires(name) or []]
            found.add(name)
    return found


def lend(distributions: set[str], folder: Path) -> None:
    """Links what distributions installed here into a folder."""
    folder.mkdir()
    for name in distributions:
        distribution = metadata.distribution(name)
        for top in {file.parts[0] for file in distribution.files or []} - {"..", "__pycache__"}:
            if not (folder / top).exists():
                (folder / top).symlink_to(str(distribution.locate_file(top)))


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of the checkout."""
    base = tmp_path_factory.mktemp("wheel")
    source = base / "source"
    source.mkdir()
    for name in SOURCES:
        shutil.copy(REPOSITORY / name, source)
    for package in REPOSITORY.iterdir():
        if (package / "__init__.py").is_file():
            built = shutil.ignore_patterns("__pycache__", "*.so")
            shutil.copytree(package, source / package.name, ignore=built)
    platform = f"lib.{sysconfig.get_platform()}-{sys.implementation.cache_tag}"
    (earlier := source / "build" / platform / "swarm").mkdir(parents=True)
    (earlier / "removed_since.py").touch()
    build = ["wheel", *OFFLINE, "--no-build-isolation", "--wheel-dir", "..", "."]
    checked([*PIP, *build], source)
    (built_wheel,) = base.glob("*.whl")
    shutil.rmtree(source)
    return built_wheel


def install(wheel: Path, target: Path, lent: str) -> Path:
    """A virtual environment with the wheel, and a folder of what it depends on."""
    venv.create(target, with_pip=False)
    python = str(target / "bin" / "python")
    checked([*PIP, "--python", python, "install", *OFFLINE, str(wheel)], wheel.parent)
    (site_packages,) = target.glob("lib/python3*/site-packages")
    (site_packages / "lent.pth").write_text(lent + "\n")
    return target


@pytest.fixture(scope="module")
def environment(wheel: Path) -> Path:
    """The wheel with all that it may depend on."""
    return install(wheel, wheel.parent / "environment", sysconfig.get_path("purelib"))


@pytest.fixture(scope="module")
def robots_environment(wheel: Path) -> Path:
    """The wheel as `pip install` leaves it without an extra."""
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
    lend(needed(project["dependencies"]), lent := wheel.parent / "lent")
    return install(wheel, wheel.parent / "robot", str(lent))


@pytest.fixture(scope="module")
def coadapt(environment: Path) -> Iterator[Run]:
    """Runs the installed command in an empty directory, which is `coadapt.directory`."""
    # Short, as the paths of Unix sockets have to be.
    with tempfile.TemporaryDirectory(prefix="cw-", dir="/tmp") as directory:
        (empty := Path(directory, "empty")).mkdir()

        def run(*arguments: str, **settings: str) -> subprocess.CompletedProcess[str]:
            return subprocess.run(
                [str(environment / "bin" / "coadapt"), *arguments],
                cwd=empty,
                env={**clean(), "COADAPT_RUN_DIR": f"{directory}/run", **settings},
                capture_output=True,
                text=True,
                timeout=READY_S + 60,
            )

        yield run


def test_it_runs_from_the_environment_and_says_its_version(coadapt: Run, environment: Path) -> None:
    done = coadapt("--version")
    assert done.stdout.startswith("coadapt "), done.stderr
    where = subprocess.run(
        [environment / "bin" / "python", "-c", "import deploy, swarm; print(deploy.__file__)"],
        cwd="/",
        env=clean(),
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert where.startswith(str(environment))


def test_what_an_earlier_build_left_is_not_in_it(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    assert "swarm/session.py" in names
    assert [name for name in names if "removed_since" in name] == []


def test_loops_in_c_and_weights_are_in_it(environment: Path) -> None:
    (site_packages,) = environment.glob("lib/python3*/site-packages")
    for pattern in (
        "perception/detector/weights/*.safetensors", "deploy/dashboards/alerts.yml",
        "ego_agent/knowledge/compute.json", "ego_agent/knowledge/quality.json",
    ):  # fmt: skip
        assert list(site_packages.glob(pattern)), pattern
    if shutil.which("cc") is not None:
        assert list(site_packages.glob("perception/kernels/_coding*.so"))


def test_docker_says_that_it_needs_a_checkout(coadapt: Run, environment: Path) -> None:
    code = "from deploy.docker import image; print(image.why_not())"
    done = subprocess.run(
        [environment / "bin" / "python", "-c", code],
        cwd="/",
        env=clean(),
        capture_output=True,
        text=True,
        check=True,
    )
    assert "built from a checkout" in done.stdout
    refused = coadapt("up", "--runtime", "docker", *SWARM)
    assert refused.returncode == 1
    assert "runtime docker cannot run here" in refused.stderr


def test_messages_name_commands_that_are_there(coadapt: Run) -> None:
    done = coadapt("status", *SWARM)
    assert done.returncode == 1
    assert done.stderr == (
        "coadapt: no swarm 'wheel' is running; start one with `coadapt up --swarm wheel`\n"
    )


def test_the_sample_is_looked_for_in_the_current_directory(coadapt: Run) -> None:
    done = coadapt("ap", "--algorithm", "late")
    assert done.returncode == 1
    assert "/empty/var/data: " in done.stderr
    assert "`coadapt data`" in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_experiments_are_not_in_it_and_say_so(coadapt: Run) -> None:
    for command in (["eval", "policies"], ["eval-detector"], ["train", "--config", "factory"]):
        done = coadapt(*command)
        assert done.returncode == 1
        assert "the experiments are not in this installation" in done.stderr
        assert len(done.stderr.splitlines()) == 1


def run_in(environment: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Runs a program of an environment, away from the checkout."""
    program, *rest = arguments
    command = [str(environment / "bin" / program), *rest]
    return subprocess.run(command, cwd="/", env=clean(), capture_output=True, text=True)


def test_without_an_extra_it_brings_nothing_that_only_other_processes_need(
    robots_environment: Path,
) -> None:
    names = "['docker', 'jsonschema', 'matplotlib', 'open3d', 'starlette', 'zenoh']"
    code = f"from importlib.util import find_spec; print(*filter(find_spec, {names}))"
    assert run_in(robots_environment, "python", "-c", code).stdout == "zenoh\n"
    refused = run_in(robots_environment, "coadapt", "up")
    assert refused.returncode == 1
    assert "coadapt: the package 'aiohttp' is not installed; " in refused.stderr
    assert "pip install 'coadapt-edge[swarm]'" in refused.stderr
    assert len(refused.stderr.splitlines()) == 1


@pytest.mark.skipif(shutil.which("cc") is None, reason="apt-get install gcc libc6-dev: no compiler")
def test_without_an_extra_a_robot_and_an_ego_share_what_they_see(
    robots_environment: Path, tmp_path: Path
) -> None:
    world = ego_swarm.factory(tmp_path / "scans")
    with ego_swarm.swarm_of(world, tmp_path) as swarm:
        swarm.python = str(robots_environment / "bin" / "python")
        # Neither this directory nor a setting leads to the checkout.
        swarm.env.pop("PYTHONPATH", None)
        swarm.env["PYTHONSAFEPATH"] = "1"
        swarm.router()
        decisions = swarm.decisions(swarm.session(), "R1")
        swarm.robot("R1", "R2")
        swarm.ego(ego="R1", period_s="0.5", journal=str(tmp_path / "journal.jsonl"))
        decisions.until(lambda decision: "R2" in decision.participants)


@pytest.mark.skipif(launch.why_not() is not None, reason=str(launch.why_not()))
def test_up_without_a_sample_names_what_brings_it(coadapt: Run) -> None:
    done = coadapt("up", "--world", "opv2v", *SWARM)
    assert done.returncode == 1
    assert "`coadapt data`) brings it" in done.stderr
    refused = coadapt("up", "--world", "bag", *SWARM)
    assert "(coadapt up --world bag --data DIR)" in refused.stderr


@pytest.mark.skipif(launch.why_not() is not None, reason=str(launch.why_not()))
@pytest.mark.skipif(
    shutil.which("prometheus") is None, reason="apt-get install prometheus: it is not installed"
)
def test_a_swarm_starts_decides_and_ends_in_an_empty_directory(coadapt: Run) -> None:
    options = (
        "--prometheus-port",
        "--ego-metrics-port",
        "--qod-port",
        "--console-port",
        "--router-port",
    )
    ports = [word for option in options for word in (option, str(free_port()))]
    small = ("--robots", "2", "--rings", "16", "--wait", str(READY_S))
    try:
        up = coadapt("up", *small, *ports, *SWARM)
        assert up.returncode == 0, up.stderr
        assert "runtime netns: " in up.stderr + up.stdout
        assert "coadapt status" in up.stdout
        assert "/empty/var/wheel/journal/R1-" in up.stdout

        def decided() -> bool:
            status = coadapt("status", "--json", *SWARM)
            assert status.returncode == 0, status.stderr
            seen = json.loads(status.stdout)
            assert {process["state"] for process in seen["processes"]} == {"running"}
            alive = [robot["alive"] for robot in seen["robots"]]
            return alive == [True, True] and seen["cycle"] is not None and seen["valid"]

        await_(decided, "a valid decision with both robots")
    finally:
        assert coadapt("down", *SWARM).returncode == 0
