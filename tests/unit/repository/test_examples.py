"""The examples in docstrings do what they show."""

from __future__ import annotations

import doctest
import importlib

import pytest

from tests.support.paths import REPOSITORY

MODULES = sorted(
    ".".join(path.relative_to(REPOSITORY).with_suffix("").parts)
    for package in REPOSITORY.iterdir()
    if package.name != "tests" and (package / "__init__.py").exists()
    for path in package.rglob("*.py")
    if ">>> " in path.read_text()
)


def test_there_are_examples_of_what_users_start_with() -> None:
    assert {
        "coadapt.api.fusing",
        "coadapt.api.scans",
        "ego_agent.plan.policies.registry",
        "perception.codec.points",
        "perception.fusion.registry",
        "perception.scene.description",
        "swarm.messages.wire",
        "worlds.cooperative.fusing",
        "worlds.registry",
    } <= set(MODULES)


@pytest.mark.parametrize("name", MODULES)
def test_the_examples_of_a_module_hold(name: str) -> None:
    done = doctest.testmod(importlib.import_module(name))
    assert done.attempted > 0
    assert done.failed == 0
