"""The layout of docs/architecture.md, held against the code's own imports."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
PROCESSES = {"robot_agent", "ego_agent", "network_controller", "llm_gateway", "console"}
PURE = {"swarm.errors", "swarm.files", "swarm.geometry"}


def imported(package: str) -> set[tuple[str, str]]:
    """(file, module) for every import statement of a package, also those inside functions."""
    found = set()
    for path in (REPOSITORY / package).rglob("*.py"):
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


def top(module: str) -> str:
    return module.split(".")[0]


@pytest.mark.parametrize("package", ["perception", "worlds"])
def test_perception_and_worlds_know_nothing_that_sends_of_the_swarm(package: str) -> None:
    allowed = {"perception": {"perception"}, "worlds": {"perception", "worlds"}}[package]
    ours = PROCESSES | {"perception", "worlds", "deploy", "coadapt", "benchmarks", "training"}
    for path, module in imported(package):
        assert top(module) != "zenoh", path
        if top(module) == "swarm":
            assert module in PURE, f"{path} imports {module}"
        elif top(module) in ours:
            assert top(module) in allowed, f"{path} imports {module}"


@pytest.mark.parametrize("process", sorted(PROCESSES))
def test_processes_never_import_each_other(process: str) -> None:
    for path, module in imported(process):
        assert top(module) not in PROCESSES - {process}, f"{path} imports {module}"
        assert top(module) not in {"deploy", "coadapt", "benchmarks"}, f"{path} imports {module}"


@pytest.mark.parametrize(
    ("package", "allowed"),
    [
        ("swarm", set()),
        ("network_controller", {"swarm"}),
        ("llm_gateway", {"swarm"}),
        ("console", {"swarm", "worlds"}),
        ("deploy", {"swarm", "worlds"}),
        ("training", {"swarm", "perception", "worlds"}),
        ("evaluation", rooms() - {"robot_agent", "benchmarks", "coadapt", "tests"}),
        ("recordings", {"swarm", "perception", "worlds", "deploy", "evaluation"}),
        ("ros2", {"swarm", "perception", "worlds"}),
        ("robot_agent", {"swarm", "perception", "worlds", "ros2"}),
        ("ego_agent", {"swarm", "perception", "worlds", "ros2"}),
    ],
)
def test_a_room_imports_only_what_the_table_says(package: str, allowed: set[str]) -> None:
    for path, module in imported(package):
        if top(module) in rooms():
            assert top(module) in allowed | {package}, f"{path} imports {module}"


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
    assert ego["knowledge"] == set()
    assert ego["monitor"] == ego["analyze"] == {"knowledge"}
    assert ego["plan"] == {"knowledge", "settings"}
    assert ego["execute"] == {"knowledge", "monitor"}


def test_using_perception_and_a_world_loads_neither_zenoh_nor_open3d() -> None:
    code = (
        "import sys, perception.scene, perception.fusion.registry, worlds.registry\n"
        "print([m for m in ('zenoh', 'open3d') if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=REPOSITORY, check=True
    )
    assert done.stdout.strip() == "[]"
