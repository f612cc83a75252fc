"""Which runtime is taken, and what is said when one cannot run here."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from deploy import runtimes
from deploy.netns import launch
from swarm.errors import DeployError

pytestmark = pytest.mark.filterwarnings(
    "ignore::pytest.PytestUnraisableExceptionWarning", "ignore::ResourceWarning"
)


@pytest.fixture
def no_docker(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[None]:
    """A machine on which no Docker engine answers."""
    monkeypatch.setenv("DOCKER_HOST", f"unix://{tmp_path}/nothing.sock")
    yield
    # docker-py leaves the socket that it could not connect; its warning belongs to this test.
    gc.collect()


@pytest.fixture
def no_namespaces(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A machine whose kernel forbids namespaces."""
    script = tmp_path / "unshare"
    script.write_text(
        "#!/bin/sh\necho 'unshare: unshare failed: Operation not permitted' >&2\nexit 1\n"
    )
    script.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")


@pytest.mark.usefixtures("no_docker")
def test_without_docker_auto_takes_namespaces_and_says_why() -> None:
    refused = launch.why_not()
    if refused is not None:
        pytest.skip(refused)
    runtime, why = runtimes.choose("auto")
    assert runtime.name == "netns"
    assert "no Docker engine answers" in why


@pytest.mark.usefixtures("no_docker", "no_namespaces")
def test_where_nothing_can_run_both_reasons_are_named() -> None:
    with pytest.raises(DeployError, match=r"docker: no Docker engine.*netns: .*not permitted"):
        runtimes.choose("auto")


def test_an_unknown_runtime_is_named() -> None:
    with pytest.raises(DeployError, match="'podman' is not known; allowed: auto, docker, netns"):
        runtimes.choose("podman")


@pytest.mark.usefixtures("no_docker")
def test_asking_for_docker_without_an_engine_is_one_line_and_exit_1(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("COADAPT_RUN_DIR", str(tmp_path / "run"))
    done = subprocess.run(
        [sys.executable, "-m", "coadapt.main", "up", "--runtime", "docker", "--swarm", "never"],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert done.returncode == 1
    assert "runtime docker cannot run here: no Docker engine answers" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "run" / "never").exists()
