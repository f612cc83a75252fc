"""One file in a package is one more thing of its kind, whatever the kind."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from deploy import runtimes
from llm_gateway import backends
from llm_gateway.backends.registry import make_backend
from llm_gateway.settings import load_settings
from network_controller import drivers
from network_controller.drivers.registry import make_driver
from swarm.errors import CoAdaptError, WorldError
from swarm.log import make_logger
from swarm.registry import by_name, registered

DRIVER = """
class Mine:
    name = "mine"

    def __init__(self, swarm):
        self.swarm = swarm

DRIVERS = (Mine,)
"""
RUNTIME = """
class Mine:
    name = "mine"

RUNTIMES = (Mine,)
"""
BACKEND = """
from llm_gateway.backends.base import BackendKind
from llm_gateway.backends.none import NoBackend

BACKENDS = (BackendKind("mine", lambda settings, log: NoBackend()),)
"""

Add = Callable[[str, str], None]


@pytest.fixture
def add(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Add:
    """Puts a file into a package, as far as imports can tell."""

    def put(package: str, text: str) -> None:
        (tmp_path / "mine_for_test.py").write_text(text)
        there = sys.modules[package]
        monkeypatch.setattr(there, "__path__", [*there.__path__, str(tmp_path)])
        monkeypatch.delitem(sys.modules, f"{package}.mine_for_test", raising=False)

    return put


def test_one_new_file_is_a_new_driver(add: Add) -> None:
    add(drivers.__name__, DRIVER)
    assert make_driver("mine", "hall").swarm == "hall"  # type: ignore[attr-defined]
    with pytest.raises(CoAdaptError, match="allowed: docker, interface, mine"):
        make_driver("other", "hall")


def test_one_new_file_is_a_new_runtime(add: Add) -> None:
    add(runtimes.__name__, RUNTIME)
    assert runtimes.names() == ("docker", "mine", "netns")
    assert runtimes.get("mine").name == "mine"


def test_one_new_file_is_a_new_back_end(add: Add) -> None:
    add(backends.__name__, BACKEND)
    settings = load_settings({"COADAPT_LLM_BACKEND": "mine"})
    assert make_backend(settings, make_logger("test", level="error")).model == "none"


def test_what_is_not_installed_has_nothing_and_what_is_broken_says_so(add: Add) -> None:
    assert not list(registered("DRIVERS", "not_installed_here"))
    add(drivers.__name__, "import not_installed_here")
    with pytest.raises(ModuleNotFoundError, match="not_installed_here"):
        make_driver("netns", "hall")


def test_two_of_one_name_are_refused() -> None:
    kinds = runtimes.get("netns"), runtimes.get("netns")
    with pytest.raises(WorldError, match="two worlds are called 'netns'"):
        by_name(kinds, "worlds", WorldError)
