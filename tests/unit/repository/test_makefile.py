"""What the Makefile starts is there."""

from __future__ import annotations

import importlib.util
import re

import pytest

from tests.support.paths import REPOSITORY

MODULES = sorted(set(re.findall(r"-m ([a-z_.]+)", (REPOSITORY / "Makefile").read_text())))


@pytest.mark.parametrize("module", MODULES)
def test_every_module_that_a_target_runs_is_there(module: str) -> None:
    assert importlib.util.find_spec(module) is not None


def test_every_benchmark_of_the_list_is_there() -> None:
    (names,) = re.findall(r"^BENCHMARKS = (.*)$", (REPOSITORY / "Makefile").read_text(), re.M)
    for name in names.split():
        assert importlib.util.find_spec(f"research.benchmarks.{name}") is not None, name
