"""A swarm of processes that is recorded as `up` records one, for the tests of commands."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from deploy.spec import make_spec
from deploy.state import State, make_run_dir, write_state
from swarm.messages import Decision
from tests.support.ego_swarm import Swarm, factory, swarm_of
from tests.support.free_ports import free_port

EGO, OTHER = "R1", "R2"
OTHER_METRICS = free_port()


@pytest.fixture(name="swarm")
def recorded_swarm(
    tmp_path_factory: pytest.TempPathFactory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Swarm]:
    """A router and a robot beside the ego's own, which is not started."""
    with swarm_of(factory(tmp_path_factory.getbasetemp() / "scans"), tmp_path) as found:
        monkeypatch.setenv("COADAPT_RUN_DIR", str(tmp_path / "run"))
        spec = make_spec(swarm="test", robots=(EGO, OTHER), var_dir=str(tmp_path))
        make_run_dir(spec)
        write_state(State(runtime="netns", spec=spec, router=found.address))
        found.router()
        found.robot(OTHER, metrics_port=str(OTHER_METRICS))
        yield found


def start_ego(swarm: Swarm, journal: Path | None = None) -> subprocess.Popen[bytes]:
    """The ego, who has everybody in range."""
    kept = {} if journal is None else {"journal": str(journal)}
    return swarm.ego(ego=EGO, comm_range_m="500", period_s="0.25", **kept)


def together(decision: Decision) -> bool:
    """Whether the other robot takes part."""
    return OTHER in decision.participants
