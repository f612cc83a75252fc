"""The layout of docs/architecture.md, held against the code's own imports."""

from __future__ import annotations

import ast
import subprocess
import sys
import tomllib
from collections import defaultdict
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from deploy.docker import image
from tests.support.paths import REPOSITORY

PROCESSES = {"robot_agent", "ego_agent", "network_controller", "llm_gateway", "options.console"}
PRODUCT = (PROCESSES - {"options.console"}) | {
    "swarm", "perception", "worlds", "sensing", "deploy", "coadapt",
}  # fmt: skip
PURE = {"swarm.body", "swarm.errors", "swarm.files", "swarm.geometry", "swarm.registry"}


def imported(package: str) -> set[tuple[str, str]]:
    """(file, module) for every import statement of a package, also those inside functions."""
    found = set()
    for path in REPOSITORY.joinpath(*package.split(".")).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                found |= {(str(path.relative_to(REPOSITORY)), name.name) for name in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                modules = (
                    [f"swarm.{name.name}" for name in node.names]
                    if node.module == "swarm"
                    else [node.module]
                )
                found |= {(str(path.relative_to(REPOSITORY)), module) for module in modules}
    return found


def rooms() -> set[str]:
    return {path.name for path in REPOSITORY.iterdir() if (path / "__init__.py").exists()}


def room_of(module: str) -> str:
    """Options and research are many rooms, the others one each."""
    parts = module.split(".")
    return ".".join(parts[: 2 if parts[0] in ("options", "research") else 1])


def test_every_room_is_product_option_or_research() -> None:
    assert rooms() - {"tests"} == PRODUCT | {"options", "research"}


def test_an_installation_and_an_image_hold_product_and_options() -> None:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())
    packages = project["tool"]["setuptools"]["packages"]["find"]["include"]
    assert {name.rstrip("*") for name in packages} == PRODUCT | {"options"}
    assert set(image.PACKAGES) == PRODUCT | {"options"}


@pytest.mark.parametrize("package", ["perception", "worlds"])
def test_perception_and_worlds_know_nothing_that_sends_of_the_swarm(package: str) -> None:
    allowed = {"perception": {"perception"}, "worlds": {"perception", "worlds"}}[package]
    for path, module in imported(package):
        assert room_of(module) != "zenoh", path
        if room_of(module) == "swarm":
            assert module in PURE, f"{path} imports {module}"
        elif room_of(module) in rooms():
            assert room_of(module) in allowed, f"{path} imports {module}"


@pytest.mark.parametrize("process", sorted(PROCESSES))
def test_processes_never_import_each_other(process: str) -> None:
    for path, module in imported(process):
        assert room_of(module) not in PROCESSES - {process}, f"{path} imports {module}"
        assert room_of(module) not in {"deploy", "coadapt"}, f"{path} imports {module}"


@pytest.mark.parametrize("package", sorted(PRODUCT - {"coadapt"}))
def test_the_product_imports_neither_options_nor_research(package: str) -> None:
    for path, module in imported(package):
        if module.split(".")[0] in ("options", "research"):
            assert path.startswith("coadapt/commands/"), f"{path} imports {module}"


def test_commands_load_options_and_research_only_when_they_run() -> None:
    for path in (REPOSITORY / "coadapt").rglob("*.py"):
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.ImportFrom) and node.module:
                assert node.module.split(".")[0] not in ("options", "research"), path


def test_options_do_not_import_research() -> None:
    for path, module in imported("options"):
        assert module.split(".")[0] != "research", f"{path} imports {module}"


def test_http_is_asked_by_one_client_for_many_questions_and_one_for_single_ones() -> None:
    others = ("urllib.request", "urllib3", "requests", "httpx")
    asking = {
        path
        for package in PRODUCT | {"options"}
        for path, module in imported(package)
        if module.startswith(others)
    }
    # What comes from the Internet is fetched through the environment's proxy.
    assert asking == {"options/etsi/modules.py"}


SENSES = {"swarm", "perception", "worlds"}


@pytest.mark.parametrize(
    ("package", "allowed"),
    [
        ("swarm", set()),
        ("network_controller", {"swarm"}),
        ("llm_gateway", {"swarm"}),
        ("sensing", SENSES),
        ("robot_agent", SENSES | {"sensing"}),
        ("ego_agent", SENSES | {"sensing"}),
        ("deploy", {"swarm", "worlds"}),
        ("options.console", {"swarm", "worlds"}),
        ("options.ros", {"swarm"}),
        ("options.bags", SENSES | {"options.ros"}),
        ("options.ros2", SENSES | {"options.ros"}),
        ("options.etsi", {"swarm", "perception", "worlds"}),
        ("options.opencood", {"swarm", "perception"}),
        ("options.pictures", {"swarm", "perception"}),
        ("options.recordings", SENSES | {"deploy", "options.bags", "options.ros"}),
        ("research.training", SENSES | {"sensing", "ego_agent", "llm_gateway"}),
        (
            "research.chaos",
            SENSES | {"deploy", "ego_agent", "research.benchmarks", "research.evaluation"},
        ),
        (
            "research.fuzz",
            (PRODUCT - {"coadapt", "deploy", "robot_agent", "sensing"})
            | {"options.bags", "options.ros", "options.ros2", "options.recordings"},
        ),
        (
            "research.evaluation",
            (PRODUCT - {"robot_agent", "coadapt"}) | {"research.training", "options.pictures"},
        ),
    ],
)
def test_a_room_imports_only_what_the_table_says(package: str, allowed: set[str]) -> None:
    ours = PRODUCT | {"options", "research"}
    for path, module in imported(package):
        if module.split(".")[0] in ours:
            assert room_of(module) in allowed | {package}, f"{path} imports {module}"


def modules_imported(path: Path) -> Iterator[str]:
    """Of ours and others, full names: also of a module that is imported from its package."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            for name in node.names:
                inside = REPOSITORY.joinpath(*node.module.split("."), name.name)
                is_module = inside.is_dir() or inside.with_suffix(".py").exists()
                yield f"{node.module}.{name.name}" if is_module else node.module


FOLDERS = sorted(
    {path.parent for room in rooms() - {"tests"} for path in (REPOSITORY / room).rglob("*.py")}
)


def neighbours(folder: Path) -> dict[str, set[str]]:
    """What imports what within a folder, by name: its files, and each folder in it as one."""
    package = ".".join(folder.relative_to(REPOSITORY).parts)
    found: dict[str, set[str]] = defaultdict(set)
    for path in folder.rglob("*.py"):
        name = path.relative_to(folder).with_suffix("").parts[0]
        for module in modules_imported(path) if name != "__init__" else ():
            if module.startswith(f"{package}."):
                found[name].add(module[len(package) + 1 :].split(".")[0])
        found[name].discard(name)
    return found


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda f: str(f.relative_to(REPOSITORY)))
def test_no_neighbours_import_each_other_in_a_circle(folder: Path) -> None:
    tuple(TopologicalSorter(neighbours(folder)).static_order())


def test_the_ego_is_the_figure_of_the_paper() -> None:
    ego = neighbours(REPOSITORY / "ego_agent")
    rooms_of_ego = {p.name for p in (REPOSITORY / "ego_agent").iterdir() if p.is_dir()}
    assert rooms_of_ego - {"__pycache__"} == {"monitor", "analyze", "plan", "execute", "knowledge"}
    beside = {p.stem for p in (REPOSITORY / "ego_agent").glob("[!_]*.py")}
    assert beside == {"agent", "metrics", "replay", "settings", "steering", "wiring"}
    assert ego["knowledge"] == set()
    assert ego["monitor"] == ego["analyze"] == {"knowledge"}
    assert ego["plan"] == {"knowledge", "settings"}
    assert ego["execute"] == {"knowledge", "monitor"}


def test_using_perception_and_a_world_loads_neither_zenoh_nor_open3d() -> None:
    code = (
        "import sys, perception.scene, perception.fusion.registry, worlds.registry\n"
        "worlds.registry.world_kinds()\n"
        "print([m for m in ('zenoh', 'open3d') if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=REPOSITORY, check=True
    )
    assert done.stdout.strip() == "[]"
