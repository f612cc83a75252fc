"""Experiments: the ego has learnt whose contributions it can lay in their places."""

from __future__ import annotations

import pytest

from network_controller.profiles import Fixed
from perception.detector.weight_files import has_weights
from perception.fusion.registry import make_fusion
from research.evaluation.policies.controls import FIRST, controls
from research.evaluation.policies.decide import decisions, policy_of
from research.evaluation.policies.work_items import knowledge_of
from research.evaluation.ways.drive import Drive, Driven
from research.evaluation.ways.planned import Decided, Deciding
from research.evaluation.ways.remembered import Rehearsal
from research.evaluation.windows import announcements
from research.evaluation.windows.links import Link
from research.evaluation.windows.measure import Window
from research.evaluation.windows.placed import FRAMES, STEP, learnt, placed
from research.evaluation.windows.scenarios import Scenario
from research.training.plans import TEST_SEEDS

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not has_weights("factory"), reason="no weights: make train"),
]

LINK = Link("cell", Fixed(20_000_000))
NOISY = Scenario(
    "noisy", 7, LINK, TEST_SEEDS.start + 555_558, first_frame=60, windows=1, pose_noise_m=0.3
)
ALGORITHMS = ("early", "late")


def test_who_cannot_be_placed_is_known_before_a_window() -> None:
    window = Window(NOISY, 0)
    begins = NOISY.decision_frame(0)
    fusion = make_fusion("early", window.world.detector)
    found = placed(window.world, begins, window.ego, 45.0, fusion, NOISY.pose_noise_m)
    assert found
    assert window.ego not in found
    assert {len(frames) for frames in found.values()} == {FRAMES // STEP}
    assert not all(all(frames) for frames in found.values()), "poses are off by 0.3 m"
    right = placed(window.world, begins, window.ego, 45.0, fusion, 0.0)
    assert all(all(frames) for frames in right.values())
    nobody = placed(window.world, 0, window.ego, 45.0, fusion, NOISY.pose_noise_m)
    assert not any(nobody.values()), "nothing is before a world's first frame"


def test_what_was_left_out_counts_as_often_as_an_ego_would_have_asked() -> None:
    known = learnt({"R2": (True,) * 10, "R3": (False,) * 10, "R4": ()})
    assert known.share("R2") == known.share("R4") == 1.0
    assert known.share("R3") < 0.2


def test_a_policy_and_its_controls_do_without_whom_the_ego_could_not_place() -> None:
    window = Window(NOISY, 0)
    fusions = {name: window.fusion(name) for name in ALGORITHMS}
    heard = [announcements.heard(window.world, 60, window.ego, dict(fusions))]
    known = knowledge_of(ALGORITHMS, NOISY)
    policy = policy_of("coverage", NOISY, known)
    (before,) = decisions(NOISY, heard, known, policy)
    first = before.choice.participants[0]
    none_of_it = [{first: (False,) * 10}]
    (after,) = decisions(NOISY, heard, known, policy, none_of_it)
    assert first not in after.choice.participants
    beside = controls(NOISY, heard, known, [after], none_of_it)
    (control,) = [one for one in beside if one.policy.endswith(FIRST)]
    assert first not in control.choice.participants
    assert known.placing.share(first) == 1.0, "another window begins anew"


def test_a_drive_learns_whom_it_cannot_place() -> None:
    drive = Drive(
        "factory", TEST_SEEDS.start + 555_558, 7, 0, 60, 30, pose_noise_m=0.3, pose_memory=True
    )
    driven = Driven(drive)
    rehearsal = Rehearsal(driven, 0.1)
    everybody = dict.fromkeys(driven.nearest, "early")
    rehearsal.ask(60, everybody, {})
    assert rehearsal.placed.keys() == everybody.keys()
    assert not all(rehearsal.placed.values())


def test_a_drive_does_without_whom_it_could_not_place() -> None:
    driven = Driven(Drive("factory", TEST_SEEDS.start + 555_558, 7, 0, 60, 30))

    def participants(learns: bool) -> tuple[set[str], set[str]]:
        deciding = Deciding(driven, Decided("coverage", learns=learns), lambda _: 2e6)
        first = {*deciding.asked(0, 60)}
        for _ in range(20):
            deciding.heed(dict.fromkeys(first, False))
        deciding.asked(10, 70)
        return first, {*deciding.participants}

    first, after = participants(learns=True)
    assert after != first, "others are asked, too or instead"
    first, after = participants(learns=False)
    assert after == first


def test_a_drive_decides_by_the_sizes_that_came() -> None:
    driven = Driven(Drive("factory", TEST_SEEDS.start + 555_558, 7, 0, 60, 30))

    def participants(part: float) -> tuple[str, ...]:
        deciding = Deciding(driven, Decided("coverage", rarer=True), lambda _: 2e5)
        deciding.asked(0, 60)
        for robot in driven.nearest:
            size = round(part * driven.size(60, robot, "early", 0.1))
            deciding.receive({robot: "early"}, {robot: size}, {})
        deciding.asked(10, 70)
        return deciding.participants

    assert len(participants(10.0)) < len(participants(0.1))
