"""The paper's third snapshot end to end: the link falls, and the decision follows."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from deploy.netns import launch
from deploy.observe import Watch
from deploy.runtimes.netns import NetnsRuntime
from deploy.spec import SwarmSpec, factory_robots, make_spec
from deploy.state import need_state
from tests.support.deploy_support import await_
from tests.support.free_ports import free_port

_refused = launch.why_not()
pytestmark = [
    pytest.mark.skipif(_refused is not None, reason=str(_refused)),
    pytest.mark.skipif(shutil.which("tc") is None, reason="tc is not installed"),
]
DROP_AT_S = 60.0
LEAD_S = 25.0
"""From the start of the swarm to the drop."""
ROUND_S = 120.0
"""A minute of the wide link and a minute of the narrow one, again and again."""


@pytest.fixture
def swarm() -> Iterator[SwarmSpec]:
    """A factory whose link falls from 55 to 0.75 Mbit/s soon."""
    with (
        tempfile.TemporaryDirectory(prefix="ca-", dir="/tmp") as directory,
        pytest.MonkeyPatch.context() as patch,
    ):
        patch.setenv("COADAPT_RUN_DIR", directory)
        spec = make_spec(
            swarm="falls",
            runtime="netns",
            robots=factory_robots(6),
            scenario="bandwidth-drop",
            epoch_ns=time.time_ns() - round((DROP_AT_S - LEAD_S) * 1e9),
            prometheus=False,
            ego_metrics_port=free_port(),
            qod_port=free_port(),
            var_dir=str(Path(directory) / "var"),
        )
        runtime = NetnsRuntime()
        assert runtime.up(spec)
        try:
            yield spec
        finally:
            runtime.down(spec.swarm)


def test_points_give_way_to_what_fits_when_the_link_falls(swarm: SwarmSpec) -> None:
    with Watch(need_state(swarm.swarm), timeout_s=30.0) as watch:

        def uses_points_of_many() -> bool:
            view = watch.view()
            return view.algorithm == "early" and len(view.selected or ()) >= 4

        def gives_way() -> bool:
            """Boxes, or points less often, and no more of them than the link carries."""
            view = watch.view()
            if view.capacity_bps is None or view.capacity_bps >= 3e6 or not view.valid:
                return False
            less = view.algorithm == "late" or any(
                one.algorithm == "late" or one.rate_hz < 10.0 for one in view.assignments
            )
            fits = 8.0 * view.bytes_per_s <= view.capacity_bps
            return less and fits and len(view.selected or ()) >= 2 and view.frames_per_s > 5.0

        await_(uses_points_of_many, "early fusion of many while the link is wide", ROUND_S)
        await_(gives_way, "what fits once the link is narrow", ROUND_S)
