"""The namespaces' runtime: what it starts, refuses, survives and leaves behind.

Real namespaces, Zenoh and Prometheus; the robots are started, too, but not waited for.
"""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

from deploy import state as record
from deploy.netns import detached, launch
from deploy.ready import wait_ready
from deploy.runtimes.netns import RELAY, NetnsRuntime
from deploy.spec import SwarmSpec, factory_robots, make_spec
from deploy.state import need_state
from swarm.errors import DeployError
from tests.support.deploy_support import (
    WAIT_S,
    assert_nothing_is_left,
    network_of,
    networks_in_use,
    processes_of,
    supervisor_of,
)
from tests.support.free_ports import free_port
from tests.support.paths import REPOSITORY

NOBODY = 65534

_refused = launch.why_not()
pytestmark = [
    pytest.mark.skipif(_refused is not None, reason=str(_refused)),
    pytest.mark.skipif(shutil.which("prometheus") is None, reason="prometheus is not installed"),
]


@pytest.fixture
def base(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A short directory for run directories, as the paths of Unix sockets have to be short."""
    with tempfile.TemporaryDirectory(prefix="ca-", dir="/tmp") as directory:
        monkeypatch.setenv("COADAPT_RUN_DIR", directory)
        yield Path(directory)


def spec_of(base: Path, name: str, **values: Any) -> SwarmSpec:
    return make_spec(
        swarm=name,
        robots=factory_robots(2),
        rings=16,
        run_dir=str(base / name),
        var_dir=str(base / "var" / name),
        prometheus_port=free_port(),
        ego_metrics_port=free_port(),
        qod_port=free_port(),
        **values,
    )


def refuse(program: Path, words: str) -> None:
    """A program that fails as the real one does where the kernel does not allow it."""
    program.write_text(f"#!/bin/sh\necho '{words}' >&2\nexit 1\n")
    program.chmod(0o755)


@pytest.fixture
def runtime() -> NetnsRuntime:
    return NetnsRuntime()


@pytest.fixture
def broken(base: Path, runtime: NetnsRuntime) -> Iterator[Callable[..., SwarmSpec]]:
    """Makes specifications, and takes down what was started of them."""
    names = []

    def make(name: str, **values: Any) -> SwarmSpec:
        names.append(name)
        return spec_of(base, name, **values)

    yield make
    for name in names:
        runtime.down(name)


def test_down_leaves_nothing_behind_and_is_idempotent(
    broken: Callable[..., SwarmSpec], runtime: NetnsRuntime
) -> None:
    spec = broken("ends")
    assert runtime.up(spec)
    network = network_of(supervisor_of(spec))
    assert len(processes_of(spec)) >= 5
    assert runtime.down("ends")
    assert_nothing_is_left(spec, network)
    assert not Path(spec.run_dir).exists()
    assert not runtime.down("ends")


def test_a_killed_supervisor_takes_everything_along_and_up_starts_anew(
    broken: Callable[..., SwarmSpec], runtime: NetnsRuntime
) -> None:
    spec = broken("crashes")
    assert runtime.up(spec)
    pid = supervisor_of(spec)
    network = network_of(pid)
    os.kill(pid, signal.SIGKILL)
    assert_nothing_is_left(spec, network)
    with pytest.raises(DeployError, match="crashed"):
        runtime.status("crashes")
    assert runtime.up(spec)
    assert network_of(supervisor_of(spec)) in networks_in_use()
    assert runtime.down("crashes")
    assert not Path(spec.run_dir).exists()


def test_down_never_ends_a_process_that_took_over_a_recorded_id(
    base: Path, broken: Callable[..., SwarmSpec], runtime: NetnsRuntime
) -> None:
    spec = broken("stale")
    record.make_run_dir(spec)
    with subprocess.Popen(["sleep", "60"]) as foreign:
        mark = record.ProcessMark(foreign.pid, started_ticks=1)
        record.write_state(
            record.State(
                runtime="netns", spec=spec, router="unixsock-stream//x", processes={RELAY: mark}
            )
        )
        assert not detached.is_alive(mark)
        assert runtime.down("stale")
        detached.kill(mark)
        assert foreign.poll() is None
        foreign.kill()
    assert not Path(spec.run_dir).exists()


@pytest.mark.parametrize("which", ["prometheus_port", "ego_metrics_port", "qod_port"])
def test_a_port_in_use_is_named_before_anything_is_started(
    which: str, broken: Callable[..., SwarmSpec], runtime: NetnsRuntime
) -> None:
    spec = broken("port")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", getattr(spec, which)))
        taken.listen()
        with pytest.raises(DeployError, match=rf"port {getattr(spec, which)} on 127\.0\.0\.1"):
            runtime.up(spec)
    assert not processes_of(spec)
    assert not Path(spec.run_dir).exists()


def test_refused_namespaces_are_explained(
    tmp_path: Path,
    broken: Callable[..., SwarmSpec],
    runtime: NetnsRuntime,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    refuse(tmp_path / "unshare", "unshare: unshare failed: Operation not permitted")
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    spec = broken("refused")
    with pytest.raises(DeployError, match=r"not permitted(.|\n)*user\.max_user_namespaces"):
        runtime.up(spec)
    assert not Path(spec.run_dir).exists()


def test_a_missing_prometheus_is_explained(
    broken: Callable[..., SwarmSpec],
    runtime: NetnsRuntime,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in ("unshare", "ip"):
        program = shutil.which(name)
        assert program is not None
        (tmp_path / name).symlink_to(program)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(DeployError, match=r"apt-get install prometheus\) or .*--no-prometheus"):
        runtime.up(broken("bare"))


def test_a_directory_that_cannot_be_made_ends_the_start(
    broken: Callable[..., SwarmSpec], runtime: NetnsRuntime
) -> None:
    spec = broken("blocked")
    Path(spec.var_dir).parent.mkdir(parents=True)
    Path(spec.var_dir).write_text("in the way")
    with pytest.raises(DeployError, match="'blocked' cannot be started"):
        runtime.up(spec)
    assert not processes_of(spec)
    assert not Path(spec.run_dir).exists()


def test_a_kernel_without_shaping_is_explained_and_nothing_stays(
    tmp_path: Path,
    broken: Callable[..., SwarmSpec],
    runtime: NetnsRuntime,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    refuse(tmp_path / "tc", "RTNETLINK answers: No such file or directory")
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    spec = broken("unshaped", link_bps=5_000_000)
    assert runtime.up(spec)
    try:
        with pytest.raises(DeployError, match=r"cannot be given 5000000 bit/s: .*needs htb"):
            wait_ready(runtime, need_state(spec.swarm), WAIT_S)
    finally:
        runtime.down(spec.swarm)


def test_a_run_directory_too_long_for_sockets_is_explained(
    broken: Callable[..., SwarmSpec], runtime: NetnsRuntime
) -> None:
    spec = msgspec.structs.replace(broken("long"), run_dir=f"/tmp/{'x' * 90}/long")
    with pytest.raises(DeployError, match="set COADAPT_RUN_DIR to a shorter one"):
        runtime.up(spec)


def test_an_ordinary_user_can_run_a_swarm(tmp_path: Path) -> None:
    python = _python_of_nobody()
    with tempfile.TemporaryDirectory(prefix="cu-", dir="/tmp") as home:
        if os.getuid() == 0:
            os.chown(home, NOBODY, NOBODY)
        script = _SCRIPT.format(home=home, prometheus=free_port(), ego=free_port(), qod=free_port())
        done = subprocess.run(
            [*python, "-c", script], capture_output=True, text=True, timeout=WAIT_S * 2, cwd=home
        )
        assert done.returncode == 0, done.stderr
        user = NOBODY if os.getuid() == 0 else os.getuid()
        assert f"up and down as {user}" in done.stdout


_SCRIPT = """
import os, sys, time
os.environ["COADAPT_RUN_DIR"] = "{home}/run"
from deploy.prometheus import Prometheus
from deploy.runtimes.netns import NetnsRuntime
from deploy.spec import factory_robots, make_spec
from deploy.state import need_state
from swarm.errors import DeployError
from swarm.session import Session

runtime = NetnsRuntime()
spec = make_spec(swarm="plain", robots=factory_robots(2), prometheus_port={prometheus},
                 ego_metrics_port={ego}, qod_port={qod}, link_bps=5_000_000)
assert runtime.up(spec)
try:
    with Session(need_state("plain").router, "plain", timeout_s=30) as session:
        assert session.links() == 1
    deadline = time.monotonic() + 30
    while True:
        try:
            targets = Prometheus(need_state("plain").prometheus_url).targets()
        except DeployError:
            targets = ()
        if len(targets) == 6:
            break
        assert time.monotonic() < deadline, targets
        time.sleep(0.1)
finally:
    assert runtime.down("plain")
print("up and down as", os.getuid())
"""


def _python_of_nobody() -> list[str]:
    """A command that runs this Python's environment without root; skips where there is none."""
    packages = os.pathsep.join([str(REPOSITORY), *(p for p in sys.path if p.endswith("-packages"))])
    path = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
    drop = (
        ["setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups"]
        if os.getuid() == 0
        else []
    )
    # Root's own Python may lie in a directory that is closed to others; the system's is not.
    for program in (sys.executable, f"/usr/bin/python3.{sys.version_info.minor}"):
        command = [*drop, "env", f"PATH={path}", f"PYTHONPATH={packages}", program]
        probe = subprocess.run(
            [*command, "-c", "import deploy.runtimes.netns as n, zenoh; print(n.launch.why_not())"],
            capture_output=True,
            text=True,
            cwd="/",
        )
        if probe.returncode == 0 and probe.stdout.strip() == "None":
            return command
    pytest.skip(f"no ordinary user can run a swarm here: {probe.stdout} {probe.stderr[-300:]}")
