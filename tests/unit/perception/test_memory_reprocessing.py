"""What comes late is remembered as if it had come in time."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.memory.memory import Frame, Memory, Remembered
from perception.memory.reprocessing import KEPT_S, ReprocessingMemory
from perception.types import Boxes
from swarm.geometry import Pose

ALL = frozenset({"R5"})


def frame(number: int, *places: float, score: float = 0.9, late: bool = False) -> Frame:
    """A forklift at each x that the ego sees, or, late, that R5 has shown."""
    count = len(places)
    boxes = Boxes(
        np.array([(x, 3.0, 1.0) for x in places]).reshape(-1, 3),
        np.tile((2.5, 1.2, 2.1), (count, 1)),
        np.zeros(count),
        np.full(count, score),
        ("forklift",) * count,
    )
    here = Pose(0.1 * number, 0.0, 1.2).matrix()
    return Frame(number / 10, boxes, ALL if late else frozenset(), {}, here)


def same(one: Remembered, other: Remembered) -> None:
    assert np.array_equal(one.boxes.centers, other.boxes.centers)
    assert np.array_equal(one.boxes.scores, other.boxes.scores)
    assert np.array_equal(one.velocities, other.velocities)
    assert np.array_equal(one.ages_s, other.ages_s)


@settings(deadline=None, max_examples=30)
@given(st.lists(st.lists(st.floats(-20, 20), max_size=4), min_size=2, max_size=6), st.data())
def test_a_frame_told_anew_leaves_what_it_leaves_when_it_is_told_so_at_once(
    places: list[list[float]], data: st.DataObject
) -> None:
    late = data.draw(st.integers(0, len(places) - 1))
    anew = frame(late, *data.draw(st.lists(st.floats(-20, 20), max_size=4)), late=True)
    memory, plain = ReprocessingMemory(1.0), Memory(1.0)
    for number, xs in enumerate(places):
        memory.update(frame(number, *xs))
        at_once = plain.update(anew if number == late else frame(number, *xs))
    same(memory.update(anew), at_once)
    # And so does everything after it.
    same(memory.update(frame(len(places), 1.0)), plain.update(frame(len(places), 1.0)))


def test_objects_keep_their_numbers_though_one_before_them_was_told_late() -> None:
    memory = ReprocessingMemory(1.0)
    memory.update(frame(0))
    (own,) = memory.update(frame(1, 10.0)).ids
    told = memory.update(frame(0, -5.0, late=True))
    numbers = dict(zip(told.boxes.centers[:, 0].round().tolist(), told.ids.tolist(), strict=True))
    assert numbers[10.0] == own
    assert numbers[-5.0] not in (own, 0)
    later = memory.update(frame(2, 10.0, 15.0))
    assert len(set(later.ids.tolist())) == 3


def test_what_is_too_old_is_not_held_and_a_clock_put_back_begins_anew() -> None:
    memory = ReprocessingMemory(1.0)
    for number in range(10):
        memory.update(frame(number, 10.0))
    held = [number for number in range(10) if memory.holds(number / 10)]
    assert held == [number for number in range(10) if 0.9 - number / 10 <= KEPT_S]
    told = memory.update(Frame(-100.0, Boxes.empty()))
    assert not len(told.boxes)
    assert not memory.holds(0.9)
    assert memory.holds(-100.0)
    memory.clear()
    assert not memory.holds(-100.0)
