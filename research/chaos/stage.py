"""The swarm that faults are played on: how it is started, and how they get hold of its parts."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from deploy.netns.network import run
from deploy.paths import JOURNAL, NET, identity_path, journal_path
from deploy.ready import wait_ready
from deploy.runtimes.netns import LAUNCHER, NetnsRuntime
from deploy.spec import SwarmSpec, factory_robots, make_spec
from deploy.state import State, need_state
from research.benchmarks.ending import signals_raise

SWARM = "chaos"
READY_S = 180.0
EPOCH_S = 48 * 3600
"""The world began so long ago: a clock that is put back by hours still finds a frame."""
LOGS = "logs"
SMALL_DISKS = {JOURNAL: "32m", NET: "4m", LOGS: "48m"}
"""Folders of the swarm that lie on a file system of their own, which a fault may fill."""
CLOCK_LIBRARY = Path(__file__).with_name("clock_step.c")
CLOCK_FOLDER = "CHAOS_CLOCKS"


@dataclass(frozen=True, slots=True)
class Stage:
    """A running swarm, in namespaces of this process's own (`research.chaos.isolation`)."""

    state: State
    folder: Path
    supervisor: int
    """Process id, by which its namespaces are entered."""
    clocks: bool
    """Whether the processes' clocks can be stepped."""
    stolen: Path | None = None
    """Of a secure swarm: a copy of the identity of the first robot, in the folder of its name."""
    runtime: NetnsRuntime = field(default_factory=NetnsRuntime)

    @property
    def spec(self) -> SwarmSpec:
        """What the swarm consists of."""
        return self.state.spec

    @property
    def robots(self) -> tuple[str, ...]:
        """All but the ego's own."""
        return tuple(robot for robot in self.spec.robots if robot != self.spec.ego)

    @property
    def journal(self) -> Path:
        """The ego's journal."""
        return Path(journal_path(self.spec, self.spec.var_dir))

    def signal(self, service: str, number: int) -> None:
        """Sends a signal to a process of the swarm. Raises DeployError where it does not run."""
        self.runtime.kill(self.spec.swarm, service, number)

    def inside(self, *argv: str) -> str:
        """The output of a command in the namespaces of the swarm's bridge. Raises DeployError."""
        return run("nsenter", f"--target={self.supervisor}", "--net", "--mount", *argv)

    def disk(self, name: str) -> Path:
        """One of `SMALL_DISKS`."""
        return Path(self.spec.var_dir) / name

    def clock(self, name: str) -> Path:
        """The file that holds how far a process's clock is off; see `clock_step.c`."""
        return self.folder / "clocks" / name


@contextmanager
def swarm_stage(
    robots: int, policy: str, period_s: float, *, secure: bool = False
) -> Iterator[Stage]:
    """A swarm once its ego decides; nothing of it is left afterwards.

    Raises DeployError where it cannot be started.
    """
    runtime = NetnsRuntime()
    with signals_raise(), tempfile.TemporaryDirectory(prefix="cx-", dir="/tmp") as name:
        folder = Path(name)
        var_dir = folder / "var"
        for disk, size in SMALL_DISKS.items():
            (var_dir / disk).mkdir(parents=True)
            run("mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(var_dir / disk))
        ids = factory_robots(robots)
        clocks = _prepare_clocks(folder, (*ids[1:], "ego", "controller"))
        os.environ["COADAPT_RUN_DIR"] = name
        spec = make_spec(
            swarm=SWARM,
            robots=ids,
            rings=16,
            policy=policy,
            # Nobody is left out for where the floor happens to lead them.
            comm_range_m=200.0,
            period_s=period_s,
            epoch_ns=time.time_ns() - EPOCH_S * 1_000_000_000,
            prometheus=False,
            console=True,
            secure=secure,
            # Nothing answers there: the gateway runs, and its server is away.
            llm="http://127.0.0.1:9/v1",
            run_dir=str(folder / SWARM),
            var_dir=str(var_dir),
        )
        try:
            runtime.up(spec)
            state = need_state(SWARM)
            wait_ready(runtime, state, READY_S)
            launcher = state.processes[LAUNCHER].pid
            children = Path(f"/proc/{launcher}/task/{launcher}/children").read_text()
            stolen = _steal(spec, ids[1], folder) if secure else None
            yield Stage(state, folder, int(children), clocks, stolen, runtime)
        finally:
            runtime.down(SWARM)
            for disk in SMALL_DISKS:
                run("umount", "--lazy", str(var_dir / disk))


def keep(stage: Stage, folder: Path) -> None:
    """Copies journals and logs, which go with the swarm."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(stage.spec.var_dir, folder, ignore=shutil.ignore_patterns("filler"))


def _steal(spec: SwarmSpec, robot: str, folder: Path) -> Path:
    """A copy of a robot's identity, as a thief has it."""
    return Path(shutil.copytree(identity_path(spec.var_dir, robot), folder / "stolen" / robot))


def _prepare_clocks(folder: Path, names: tuple[str, ...]) -> bool:
    """Has every process of the swarm read its time through `clock_step.c`; false where no compiler
    is there to build it."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        return False
    library = folder / "clock_step.so"
    run(compiler, "-O2", "-shared", "-fPIC", "-o", str(library), str(CLOCK_LIBRARY), "-ldl")
    clocks = folder / "clocks"
    clocks.mkdir()
    for name in names:
        (clocks / name).write_bytes(bytes(8))
    os.environ[CLOCK_FOLDER] = str(clocks)
    os.environ["LD_PRELOAD"] = str(library)
    return True
