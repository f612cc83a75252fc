"""The layout of docs/architecture.md, held against the code's own imports."""

from __future__ import annotations

import ast
import subprocess
import sys
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


def test_using_perception_and_a_world_loads_neither_zenoh_nor_open3d() -> None:
    code = (
        "import sys, perception.scene, perception.fusion.registry, worlds.registry\n"
        "print([m for m in ('zenoh', 'open3d') if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=REPOSITORY, check=True
    )
    assert done.stdout.strip() == "[]"
