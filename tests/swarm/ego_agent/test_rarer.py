"""A whole swarm in which robots are asked less often than frames are fused."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from ego_agent.knowledge.pace import RARER_HZ, about_places, due
from perception.detector.weight_files import has_weights
from swarm import keyspace
from swarm.arrays import unpack_finite
from swarm.messages import Decision, Detections, NetDemand
from tests.support.ego_swarm import MessageLog, Swarm, factory, hear, swarm_of
from tests.support.net_controller import Controller

pytestmark = pytest.mark.skipif(not has_weights("factory"), reason="no weights: make train")


@pytest.fixture
def swarm(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Swarm]:
    scans = tmp_path_factory.getbasetemp() / "scans"
    with swarm_of(factory(scans, robots=3), tmp_path) as running:
        running.router()
        running.robot("R2", "R3")
        yield running


def test_each_frame_asks_whoever_is_due_and_tells_of_what_others_showed(swarm: Swarm) -> None:
    session = swarm.session()
    decisions: MessageLog[Decision] = swarm.decisions(session, "R1")
    frames: MessageLog[Detections] = swarm.detections(session, "R1")
    # A processor dear enough that nobody is asked ten times a second.
    swarm.ego(
        compute_weight="0.25",
        comm_range_m="500",
        q_min="0.3",
        algorithms="early",
        learn="false",
        between="false",
    )
    decided = decisions.until(lambda d: bool(d.assignments))
    assert {one.robot for one in decided.assignments} == set(decided.participants) - {"R1"}
    assert {one.rate_hz for one in decided.assignments} <= {decided.rate_hz, *RARER_HZ}
    assert {one.algorithm for one in decided.assignments} == {decided.algorithm} == {"early"}
    assert min(one.rate_hz for one in decided.assignments) < decided.rate_hz
    asked = alone = 0
    while asked < 3 or alone < 3:
        frame = frames.until(lambda d: d.cycle > decided.cycle)
        carried_out = the_decision(decisions, frame.cycle)
        wanted = {
            robot
            for robot in carried_out.participants
            if robot != "R1" and due(carried_out, robot, frame.frame)
        }
        assert {*frame.participants, *frame.missing} - {"R1"} == wanted
        asked, alone = asked + bool(wanted), alone + (not wanted)
        assert frame.tracks is not None
    # Between contributions, what was shown is told of.
    frames.until(
        lambda d: (
            d.participants == ("R1",)
            and d.tracks is not None
            and any(age > 0.0 for age in unpacked(d))
        )
    )


def test_between_whole_contributions_robots_are_asked_about_what_is_remembered(
    swarm: Swarm,
) -> None:
    session = swarm.session()
    decisions: MessageLog[Decision] = swarm.decisions(session, "R1")
    frames: MessageLog[Detections] = swarm.detections(session, "R1")
    # Bytes so dear that whole contributions are rare.
    swarm.ego(
        link_weight="4",
        compute_weight="0",
        comm_range_m="500",
        q_min="0.3",
        algorithms="early",
        learn="false",
    )

    def asks_between(decision: Decision) -> bool:
        return any(one.places_hz > one.rate_hz for one in decision.assignments)

    decided = decisions.until(asks_between)
    assert "in between what they see where something is remembered" in decided.reason
    whole: dict[str, int] = {}
    places: dict[str, int] = {}
    while not (whole.keys() & places.keys()):
        frame = frames.until(lambda d: d.cycle >= decided.cycle)
        carried_out = the_decision(decisions, frame.cycle)
        about = about_places(carried_out.assignments, carried_out.rate_hz, frame.frame)
        assert {*frame.focused} <= {*about}
        for robot, size in frame.bytes.items():
            if robot in frame.objects_only:
                continue
            (places if robot in frame.focused else whole)[robot] = size
    for robot in whole.keys() & places.keys():
        assert places[robot] < whole[robot]


def test_a_narrower_link_leads_to_rarer_and_smaller_contributions_and_memory_goes_on(
    swarm: Swarm,
) -> None:
    session = swarm.session()
    decisions: MessageLog[Decision] = swarm.decisions(session, "R1")
    frames: MessageLog[Detections] = swarm.detections(session, "R1")
    demands = hear(session, keyspace.net_demand("test"), NetDemand)
    # Bytes cost nothing while the link carries them.
    swarm.ego(
        link_weight="0",
        compute_weight="0",
        comm_range_m="500",
        q_min="0.3",
        algorithms="early,late",
        learn="false",
    )
    controller = Controller(session, decisions)
    wide_bps = 20_000_000
    wide = controller.shape(
        wide_bps, lambda d: d.capacity_bps == wide_bps and len(d.participants) == 3
    )[-1]
    narrow_bps = round(0.5 * bits_s(wide) / 0.8)

    made = controller.shape(narrow_bps, lambda d: d.capacity_bps == narrow_bps)
    # One may have been under way, and each cycle hears what was said before it.
    assert len(made) <= 3
    narrow = made[-1]
    assert bits_s(narrow) <= 0.8 * narrow_bps
    assert narrow.assignments
    said = demands.until(lambda d: d.cycle >= narrow.cycle)
    assert said.mean_bytes_s * 8 <= 0.8 * narrow_bps + 100

    def remembers(frame: Detections) -> bool:
        old = frame.tracks is not None and any(age > 0.0 for age in unpacked(frame))
        return frame.cycle >= narrow.cycle and old

    told = frames.until(remembers)
    assert told.tracks is not None
    assert len(told.tracks.ids) >= 1


def bits_s(decision: Decision) -> float:
    return 8.0 * decision.cost_bytes * decision.rate_hz


def the_decision(decisions: MessageLog[Decision], cycle: int) -> Decision:
    """That of a cycle; a frame of it may be heard first."""
    for one in list(decisions.all):
        if one.cycle == cycle:
            return one
    return decisions.until(lambda d: d.cycle == cycle)


def unpacked(frame: Detections) -> list[float]:
    """How long ago each track was seen, seconds."""
    assert frame.tracks is not None
    ages: list[float] = unpack_finite(frame.tracks.ages_s, "ages_s", 1)[:, 0].tolist()
    return ages
