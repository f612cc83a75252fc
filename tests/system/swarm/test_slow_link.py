"""Answers larger than a slow link can carry cost their askers an error, never the connection."""

from __future__ import annotations

import json

import pytest
import zenoh

from deploy.netns import launch
from swarm import zenoh_config
from swarm.chunks import PART_BYTES
from swarm.traffic import LINKS
from tests.support.slow_link import BEACON_PERIOD_S, Plan, Seen, see_slow_link

_refused = launch.why_not()
needs_namespaces = pytest.mark.skipif(_refused is not None, reason=str(_refused))
MBIT = 1_000_000
NEAR = 0.2
"""What TCP's view of a rate is off: headers, beacons, and how even its samples are."""
WAIT = "transport/link/tx/queue/congestion_control/block/wait_before_close"


def assert_nothing_broke(seen: Seen, servers: int) -> None:
    """The transport stayed open, control traffic flowed, and small questions are answered."""
    assert seen.fewest_links == LINKS
    assert seen.reopened == 0
    assert seen.left == []
    assert len(seen.small) == servers
    assert all(isinstance(small, int) for small in seen.small), seen.small
    assert seen.beacons > servers * seen.waited_s / BEACON_PERIOD_S / 2


@needs_namespaces
def test_a_large_answer_comes_whole_over_a_slow_link() -> None:
    seen = see_slow_link(Plan(servers=1, answer_bytes=800_000, timeout_s=30.0, rate_bps=MBIT))
    assert seen.errors == []
    assert seen.answers[0] > 800_000
    assert_nothing_broke(seen, 1)
    assert seen.capacity_bps == pytest.approx(MBIT, rel=NEAR)


@needs_namespaces
def test_answers_that_come_too_late_end_with_errors_and_stop() -> None:
    seen = see_slow_link(Plan(servers=4, answer_bytes=300_000, timeout_s=4.0, rate_bps=MBIT))
    assert seen.errors
    assert len(seen.errors) + len(seen.answers) == 4
    for error in seen.errors:
        assert "incomplete answer on coadapt/slow/robot/R" in error
    assert_nothing_broke(seen, 4)
    # What nobody waited for any more was not sent.
    assert seen.fusion_bytes < 4 * 300_000 * 0.75


@needs_namespaces
def test_a_large_answer_survives_a_collapse_of_its_links_rate() -> None:
    plan = Plan(
        servers=1, answer_bytes=2_000_000, timeout_s=40.0, rate_bps=50 * MBIT, later_bps=MBIT
    )
    seen = see_slow_link(plan)
    assert seen.errors == []
    assert seen.answers[0] > 2_000_000
    assert_nothing_broke(seen, 1)
    assert seen.capacity_bps == pytest.approx(MBIT, rel=NEAR)


def test_routers_and_clients_wait_as_long_as_the_lease_for_a_slow_link() -> None:
    for settings in (
        zenoh_config.router_config("127.0.0.1", 7447),
        zenoh_config.client_config("tcp/127.0.0.1:7447"),
    ):
        config = zenoh.Config.from_json5(json.dumps(zenoh_config.nested(settings)))
        lease_ms = json.loads(config.get_json("transport/link/tx/lease"))
        assert json.loads(config.get_json(WAIT)) == lease_ms * 1000
        assert json.loads(config.get_json("transport/link/tx/batch_size")) > PART_BYTES
