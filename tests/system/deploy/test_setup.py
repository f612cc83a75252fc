"""What `make setup` installs: what the project names, and no build for graphics cards."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tomllib
from importlib.metadata import requires
from pathlib import Path

from packaging.requirements import Requirement

from tests.support.paths import REPOSITORY

TORCH = "requirements-torch.lock"
RUN = ("requirements.lock", TORCH)


def pins(*locks: str) -> dict[str, str]:
    """Version by package of some locks."""
    text = "".join((REPOSITORY / lock).read_text() for lock in locks)
    found = re.findall(r"^([\w.-]+)==([^\s;]+)", text, re.MULTILINE)
    return {plain(name): version for name, version in found}


def plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def unmet(wanted: list[str], pinned: dict[str, str]) -> list[str]:
    """The requirements that a lock does not meet."""
    found = [Requirement(text) for text in wanted]
    here = [r for r in found if r.marker is None or r.marker.evaluate({"extra": ""})]
    return [str(r) for r in here if not r.specifier.contains(pinned.get(plain(r.name), "0"))]


def test_the_locks_pin_versions_that_the_project_allows() -> None:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    (swarm,) = (Requirement(text) for text in extras["swarm"])
    runs = project["dependencies"] + [text for name in swarm.extras for text in extras[name]]
    assert unmet(runs, pins(*RUN)) == []
    others = ("dev", "figures", "llm-server", "recordings")
    checks = [text for name in others for text in extras[name]]
    assert unmet(checks, pins(*RUN, "requirements-dev.lock")) == []
    assert not pins(*RUN).keys() & pins("requirements-dev.lock").keys()


def test_every_file_but_pytorchs_has_a_hash_and_no_index_is_named() -> None:
    for lock in ("requirements.lock", "requirements-dev.lock"):
        text = (REPOSITORY / lock).read_text()
        heads = re.findall(r"^\w[^#\n]*$(?:\n +--hash=sha256:[0-9a-f]{64})?", text, re.MULTILINE)
        assert len(heads) == len(pins(lock)) > 10
        assert [head for head in heads if "--hash" not in head] == []
        assert "://" not in text


def test_what_pytorch_needs_is_pinned_and_nothing_for_graphics_cards() -> None:
    assert unmet(requires("torch") or [], pins(*RUN)) == []
    everything = pins(*RUN, "requirements-dev.lock", "requirements-llm.lock")
    assert not [name for name in everything if re.match(r"nvidia|triton|cuda", name)]
    # Only its own lock names PyTorch: that one asks the index with the processor's build.
    assert "torch" not in pins("requirements.lock", "requirements-dev.lock")


def test_setup_says_what_to_do_where_pytorch_cannot_be_had(tmp_path: Path) -> None:
    (tmp_path / "deploy").mkdir()
    for name in ("deploy/setup.sh", "deploy/apt.sh", "pyproject.toml", *RUN):
        shutil.copy(REPOSITORY / name, tmp_path / name)
    (tmp_path / "requirements-dev.lock").touch()
    lock = (tmp_path / TORCH).read_text()
    (tmp_path / TORCH).write_text(re.sub(r"--index-url .*", "--index-url http://127.0.0.1:9", lock))
    (tmp_path / "wheels").mkdir()
    settings = {
        **{"PIP_FIND_LINKS": str(tmp_path / "wheels"), "PIP_RETRIES": "0"},
        **{"SKIP_SYSTEM": "1", "EXTRA": ""},
    }
    done = subprocess.run(
        ["sh", "deploy/setup.sh"],
        cwd=tmp_path,
        env={**os.environ, **settings},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1
    assert "PyTorch could not be installed: torch==" in done.stderr
    assert f"PIP_FIND_LINKS ('{tmp_path}/wheels')" in done.stderr
    # The next `make setup` tries again.
    assert not (tmp_path / ".venv" / ".setup-done").exists()
