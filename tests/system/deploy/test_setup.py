"""What `make setup` installs: what the project names, and no build for graphics cards."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import tomllib
import venv
import zipfile
from importlib.metadata import requires
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from tests.support.paths import REPOSITORY

TORCH = "requirements-torch.lock"
RUN = ("requirements.lock", TORCH)
SCRIPTS = ("deploy/setup.sh", "deploy/apt.sh", "deploy/locked.sh")
PIP = 'say() { echo "setup: $*" >&2; }; venv=$1; . deploy/locked.sh; locked_pip install -r "$2"'


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
    for lock in ("requirements.lock", "requirements-dev.lock", "requirements-llm.lock"):
        text = (REPOSITORY / lock).read_text()
        heads = re.findall(r"^\w[^#\n]*$(?:\n +--hash=sha256:[0-9a-f]{64})?", text, re.MULTILINE)
        assert len(heads) == len(pins(lock)) > 2
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
    for name in (*SCRIPTS, "pyproject.toml", *RUN):
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


def tiny_wheel(folder: Path, name: str) -> Path:
    """A wheel of one module, version 1.0."""
    folder.mkdir(exist_ok=True)
    path = folder / f"{name}-1.0-py3-none-any.whl"
    info = f"{name}-1.0.dist-info"
    with zipfile.ZipFile(path, "w") as wheel:
        wheel.writestr(f"{name}.py", "")
        wheel.writestr(f"{info}/METADATA", f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        wheel.writestr(f"{info}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\n")
        wheel.writestr(f"{info}/RECORD", "")
    return path


@pytest.fixture(scope="module")
def empty_venv(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("locked") / "venv"
    venv.create(folder, with_pip=True)
    return folder


def locked(folder: Path, wheels: Path, *lines: str) -> subprocess.CompletedProcess[str]:
    """What `make setup` does with a lock of these lines, where pip has but a folder of wheels."""
    lock = wheels / "requirements.lock"
    lock.write_text("".join(f"{line}\n" for line in lines))
    only = {"PIP_FIND_LINKS": str(wheels), "PIP_NO_INDEX": "1", "PIP_CONFIG_FILE": os.devnull}
    return subprocess.run(
        ["sh", "-euc", PIP, "sh", str(folder), str(lock)],
        cwd=REPOSITORY,
        env={**os.environ, **only},
        capture_output=True,
        text=True,
    )


def test_a_file_of_the_pinned_hash_is_installed(tmp_path: Path, empty_venv: Path) -> None:
    digest = hashlib.sha256(tiny_wheel(tmp_path, "rightly").read_bytes()).hexdigest()
    done = locked(empty_venv, tmp_path, f"rightly==1.0 --hash=sha256:{digest}")
    assert done.returncode == 0, done.stderr
    assert list(empty_venv.glob("lib/python3*/site-packages/rightly.py"))


def test_a_file_of_another_hash_ends_with_its_name_and_a_remedy(
    tmp_path: Path, empty_venv: Path
) -> None:
    good, bad = (tiny_wheel(tmp_path, name) for name in ("sound", "tampered"))
    digest = hashlib.sha256(good.read_bytes()).hexdigest()
    lines = [f"{path.name.partition('-')[0]}==1.0 --hash=sha256:{digest}" for path in (good, bad)]
    done = locked(empty_venv, tmp_path, *lines)
    assert done.returncode == 1
    assert "setup: refused: tampered==1.0 is not the file that the lock pins" in done.stderr
    assert f"PIP_FIND_LINKS='{tmp_path}'" in done.stderr
    assert "https://pypi.org/project/tampered/#files" in done.stderr
    # Not even what was right: an installation is whole or it is none.
    assert not list(empty_venv.glob("lib/python3*/site-packages/sound.py"))


def test_a_line_without_a_hash_is_refused(tmp_path: Path, empty_venv: Path) -> None:
    tiny_wheel(tmp_path, "unhashed")
    done = locked(empty_venv, tmp_path, "unhashed==1.0")
    assert done.returncode == 1
    assert "unhashed==1.0" in done.stderr
    assert not list(empty_venv.glob("lib/python3*/site-packages/unhashed.py"))
