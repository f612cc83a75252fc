"""What an ego tells from memory of frames that follow each other."""

from __future__ import annotations

from dataclasses import replace

import pytest

from perception.fusion.registry import make_fusion
from swarm.errors import PerceptionError
from worlds.cooperative.fusing import SINGLE, Disturbance
from worlds.cooperative.judging import tallied
from worlds.cooperative.remembering import remembered_frames
from worlds.factory.world import FactoryWorld

FRAMES = range(20, 32)


@pytest.fixture(scope="module")
def floor() -> FactoryWorld:
    return FactoryWorld(robots=3, rings=16)


def test_robots_send_as_often_as_asked(floor: FactoryWorld) -> None:
    told = dict(remembered_frames(floor, "late", "R1", frames=FRAMES, rate_hz=2.5))
    assert list(told) == list(FRAMES)[3:]
    sending = [frame for frame, fused in told.items() if fused.bytes]
    assert sending == [24, 28]
    assert set(told[24].bytes) == {"R2", "R3"}


def test_what_comes_late_is_taken_up_when_it_comes(floor: FactoryWorld) -> None:
    in_time = remembered_frames(floor, "late", "R1", frames=FRAMES)
    late = remembered_frames(floor, "late", "R1", Disturbance(delay_s=0.2), FRAMES)
    for (_, now), (_, then) in zip(list(in_time)[:-2], list(late)[2:], strict=True):
        assert now.bytes == then.bytes


def test_memory_makes_up_for_late_contributions(floor: FactoryWorld) -> None:
    late = Disturbance(delay_s=0.5)
    own = tallied(floor, SINGLE, "R1", None, FRAMES, remembered=True).precision()
    told = tallied(floor, "early", "R1", late, FRAMES, remembered=True).precision()
    assert told.ap_50 > own.ap_50
    assert told.frames == own.frames == len(FRAMES) - 3


@pytest.mark.parametrize(
    ("delay_s", "rate_hz", "said"),
    [
        (0.0, 0.0, "rate 0 Hz is not allowed; allowed: above 0, at most 10"),
        (0.0, 11.0, "rate 11 Hz"),
        (0.7, None, "0.7 s late are not remembered; allowed: at most 0.6"),
    ],
)
def test_what_cannot_be_is_refused(
    floor: FactoryWorld, delay_s: float, rate_hz: float | None, said: str
) -> None:
    with pytest.raises(PerceptionError, match=said):
        tallied(
            floor,
            "early",
            "R1",
            replace(Disturbance(), delay_s=delay_s),
            FRAMES,
            remembered=True,
            rate_hz=rate_hz,
        ).precision()


def test_scores_that_nobody_calibrated_are_refused(floor: FactoryWorld) -> None:
    mine = make_fusion("late", "factory")
    mine.name = "mine"
    with pytest.raises(PerceptionError, match="'mine' finds cannot be remembered"):
        tallied(floor, mine, "R1", None, FRAMES, remembered=True)
