"""Memory: objects keep their identity, live on between frames, and end where they are gone."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.codec.places import encode_places, within
from perception.memory.asking import places_of
from perception.memory.memory import (
    FAINTEST,
    MOST_TRACKS,
    Frame,
    Memory,
    Remembered,
    View,
)
from perception.types import Boxes
from swarm.geometry import Matrix, Points, Pose, invert

SIZE = (2.5, 1.2, 2.1)
HERE = Pose(0.0, 0.0, 1.2).matrix()
BOTH = frozenset({"R5"})


def boxes(*places: tuple[float, float], score: float = 0.9, label: str = "forklift") -> Boxes:
    count = len(places)
    return Boxes(
        centers=np.array([(x, y, 1.05) for x, y in places]).reshape(-1, 3),
        sizes=np.tile(SIZE, (count, 1)),
        headings=np.zeros(count),
        scores=np.full(count, score),
        labels=(label,) * count,
    )


def floor(*walls: tuple[float, float, float]) -> Points:
    """Returns of a sensor 1.2 m above a floor: where the floor ends at 30 m, or at a wall: azimuth
    from, to (radians) and distance (m) of each."""
    rays = []
    for azimuth in np.linspace(-np.pi, np.pi, 720, endpoint=False):
        away = min([far for low, high, far in walls if low <= azimuth < high], default=30.0)
        for slope in np.linspace(-0.35, 0.2, 32):
            reach = away if slope >= 0.0 else min(away, 1.2 / -slope)
            rays.append((np.cos(azimuth) * reach, np.sin(azimuth) * reach, slope * reach))
    return np.array(rays, dtype=np.float32)


EMPTY_FLOOR = floor()
WALLED = floor((-0.5, 0.5, 5.0))
"""Nothing is seen ahead beyond 5 m."""


def frame(
    time_s: float,
    found: Boxes,
    helpers: frozenset[str] = frozenset(),
    own: Points | None = None,
    at: Matrix = HERE,
) -> Frame:
    views: dict[str, View] = {} if own is None else {"R1": (own, at)}
    return Frame(time_s, found, helpers, views, at)


def seen(memory: Memory, times: int = 5, step_s: float = 0.1, **where: float) -> Remembered:
    """What is told of a forklift that was seen so often from time 0 on, at x, y with a speed vx."""
    x, y, vx = (where.get(name, default) for name, default in (("x", 10.0), ("y", 0.0), ("vx", 0)))
    for i in range(times):
        found = boxes((x + vx * i * step_s, y))
        told = memory.update(frame(i * step_s, found, BOTH, WALLED))
    return told


def in_turn(views: dict[str, View]) -> list[float]:
    """The chances that a memory tells after each frame of a forklift that R5 shows in every
    second one, and R6, whose cloud is there in the others, does not; the ego sees a wall."""
    memory, chances = Memory(1.0), []
    for i in range(20):
        shows = i % 2 == 0
        found = boxes((10.0, 0.0)) if shows else Boxes.empty()
        views_now = {"R1": (WALLED, HERE)} | ({} if shows else views)
        helper = frozenset({"R5" if shows else "R6"})
        told = memory.update(Frame(i / 10, found, helper, views_now, HERE))
        chances.append(max([0.0, *told.boxes.scores]))
    return chances


class TestIdentity:
    def test_an_object_keeps_its_number(self) -> None:
        memory = Memory(1.0)
        first = seen(memory, 1).ids
        assert seen(Memory(1.0), 8).ids.tolist() == first.tolist() == [1]

    @given(st.floats(-2, 2), st.floats(0.8, 1.0))
    def test_it_is_told_where_it_is_and_how_fast(self, speed: float, score: float) -> None:
        memory = Memory(1.0)
        for i in range(20):
            told = memory.update(frame(i / 10, boxes((i / 10 * speed, 3.0), score=score)))
        assert told.boxes.centers[0, :2] == pytest.approx([1.9 * speed, 3.0], abs=0.15)
        assert told.velocities[0] == pytest.approx([speed, 0.0], abs=0.2)
        assert told.ages_s.tolist() == [0.0]

    def test_a_view_that_shows_less_moves_little_of_what_others_have_shown(self) -> None:
        def after(helpers: frozenset[str], score: float) -> float:
            memory = Memory(1.0)
            seen(memory)
            found = boxes((10.3, 0.0), score=score)
            return float(memory.update(frame(0.5, found, helpers)).boxes.centers[0, 0]) - 10.0

        alone = after(frozenset(), 0.8)
        assert 0.0 < alone < 0.3 * after(BOTH, 0.8)
        # However sure it is: those who have shown it have seen what it shows, too.
        assert after(frozenset(), 0.99) < 0.3 * after(BOTH, 0.99)
        # Others may see more, and do where they are surer.
        other = frozenset({"R6"})
        assert after(other, 0.8) < 0.3 * after(BOTH, 0.8)
        assert after(other, 0.99) == pytest.approx(after(BOTH, 0.99), abs=0.02)

    def test_the_middle_of_a_part_tells_how_an_object_moves_and_not_where_it_is(self) -> None:
        memory, speed, beside = Memory(6.0), 5.0, 0.5
        for i in range(12):
            shown = i % 5 == 0
            place = speed * i / 10 - (0.0 if shown else beside)
            helpers = BOTH if shown else frozenset[str]()
            told = memory.update(frame(i / 10, boxes((place, 0.0)), helpers))
        assert told.boxes.centers[0, 0] == pytest.approx(speed * 1.1, abs=0.1)
        assert told.velocities[0, 0] == pytest.approx(speed, abs=0.3)

    @pytest.mark.parametrize("completes", [True, False])
    def test_boxes_of_others_complete_nothing_that_the_ego_sees(self, completes: bool) -> None:
        memory = Memory(1.0)
        for i in range(5):
            found = frame(i / 10, boxes((10.0, 0.0)), BOTH)
            memory.update(replace(found, completes=completes))
        told = memory.update(frame(0.5, boxes((10.3, 0.0), score=0.99)))
        moved = told.boxes.centers[0, 0] - 10.0
        assert moved < 0.05 if completes else moved > 0.1

    def test_who_has_gone_has_shown_nothing_better(self) -> None:
        memory = Memory(1.0)
        seen(memory)
        for i in range(25):
            told = memory.update(frame(0.5 + i / 10, boxes((10.3, 0.0)), own=WALLED))
        assert told.boxes.centers[0, 0] == pytest.approx(10.3, abs=0.05)

    @pytest.mark.parametrize("speed", [8.0, 15.0])
    def test_what_drives_fast_is_followed_from_its_first_frame(self, speed: float) -> None:
        memory = Memory(6.0)
        for i in range(12):
            told = memory.update(frame(i / 10, boxes((i / 10 * speed, 3.0))))
            assert told.ids.tolist() == [1]
        assert told.boxes.centers[0, 0] == pytest.approx(1.1 * speed, abs=0.25)
        assert told.velocities[0, 0] == pytest.approx(speed, rel=0.05)

    def test_two_that_pass_each_other_stay_themselves(self) -> None:
        memory = Memory(1.0)
        for i in range(40):
            t = i / 10
            pair = boxes((-2.0 + t, 0.0), (2.0 - t, 1.5))
            told = memory.update(frame(t, pair))
            if not i:
                left = told.ids[np.argmin(told.boxes.centers[:, 0])]
        assert told.ids[np.argmax(told.boxes.centers[:, 0])] == left
        assert len(told.ids) == 2

    def test_classes_are_not_mixed_up(self) -> None:
        memory = Memory(1.0)
        memory.update(frame(0.0, boxes((5, 5))))
        told = memory.update(frame(0.1, boxes((7.0, 8.0), label="person")))
        assert sorted(told.boxes.labels) == ["forklift", "person"]

    def test_a_number_is_never_given_twice(self) -> None:
        memory = Memory(1.0)
        first = set(memory.update(frame(0.0, boxes((5, 5), (9, 9)))).ids.tolist())
        memory.clear()
        assert not first & set(memory.update(frame(0.1, boxes((5, 5)))).ids.tolist())

    def test_a_part_of_a_body_is_no_other_object(self) -> None:
        memory = Memory(1.0)
        seen(memory)
        told = memory.update(frame(0.5, boxes((10.9, 0.0), label="person", score=0.4), BOTH))
        assert told.boxes.labels == ("forklift",)


class TestBetweenContributions:
    def test_what_only_a_helper_sees_lives_on_and_moves(self) -> None:
        memory = Memory(1.0)
        before = seen(memory, vx=1.5)
        # The helper sends nothing for half a second, and a wall hides the place.
        for i in range(5, 10):
            told = memory.update(frame(i / 10, Boxes.empty(), own=WALLED))
        assert told.ids.tolist() == before.ids.tolist()
        assert told.boxes.centers[0, 0] == pytest.approx(10.0 + 1.5 * 0.9, abs=0.3)
        assert told.ages_s[0] == pytest.approx(0.5)
        assert 0.25 < told.boxes.scores[0] <= before.boxes.scores[0]

    def test_certainty_falls_with_age(self) -> None:
        memory = Memory(1.0)
        scores = [seen(memory, 2).boxes.scores[0]]
        for i in range(2, 40):
            told = memory.update(frame(i / 10, Boxes.empty(), own=WALLED))
            scores.append(told.boxes.scores[0])
        assert (np.diff(scores) <= 0).all()
        assert scores[-1] < 0.9 * scores[0]

    def test_what_stands_still_is_remembered_for_long(self) -> None:
        memory = Memory(1.0)
        seen(memory, 40)
        for i in range(40, 90):
            told = memory.update(frame(i / 10, Boxes.empty(), own=WALLED))
        assert len(told.ids) == 1
        assert told.boxes.scores[0] > 0.25
        assert told.boxes.centers[0, :2] == pytest.approx([10.0, 0.0], abs=0.1)

    def test_the_same_object_comes_back(self) -> None:
        memory = Memory(1.0)
        before = seen(memory, 10, vx=1.0)
        for i in range(10, 20):
            memory.update(frame(i / 10, Boxes.empty(), own=WALLED))
        told = memory.update(frame(2.0, boxes((12.0, 0.0)), BOTH, WALLED))
        assert told.ids.tolist() == before.ids.tolist()
        assert told.ages_s.tolist() == [0.0]

    def test_who_sees_less_does_not_make_it_doubtful(self) -> None:
        memory = Memory(1.0)
        before = seen(memory)
        told = memory.update(frame(0.5, boxes((10.0, 0.0), score=0.2), own=WALLED))
        assert told.boxes.scores[0] >= 0.95 * before.boxes.scores[0]

    def test_what_those_who_see_more_do_not_show_is_doubted(self) -> None:
        memory = Memory(1.0)
        memory.update(frame(0.0, Boxes.empty(), BOTH, WALLED))
        doubted = memory.update(frame(0.1, boxes((10.0, 0.0), score=0.5), own=WALLED))
        believed = Memory(1.0).update(frame(0.1, boxes((10.0, 0.0), score=0.5), own=WALLED))
        assert doubted.boxes.scores[0] < 0.25 < believed.boxes.scores[0]


class TestEnding:
    def test_what_is_seen_free_is_free_again(self) -> None:
        memory = Memory(1.0)
        seen(memory)
        told = memory.update(frame(0.5, Boxes.empty(), own=EMPTY_FLOOR))
        assert not (told.boxes.scores > 0.3).any()
        for i in range(6, 10):
            told = memory.update(frame(i / 10, Boxes.empty(), own=EMPTY_FLOOR))
        assert not len(told.ids)

    def test_occluded_is_not_gone(self) -> None:
        memory = Memory(1.0)
        seen(memory, 30)
        for i in range(30, 60):
            told = memory.update(frame(i / 10, Boxes.empty(), BOTH - {"R5"}, WALLED))
        assert told.ages_s[0] == pytest.approx(3.0)
        assert told.boxes.scores[0] > 0.25

    def test_a_helper_that_showed_it_and_does_not_any_more_ends_it(self) -> None:
        memory = Memory(1.0)
        seen(memory)
        for i in range(5, 9):
            told = memory.update(frame(i / 10, Boxes.empty(), BOTH, WALLED))
        assert not (told.boxes.scores > 0.25).any()

    def test_of_two_that_contradict_each_other_who_sees_the_place_free_is_believed(self) -> None:
        # R5 says that there is a forklift, and the ego sees through the place.
        memory = Memory(1.0)
        for i in range(20):
            score = 0.9 if i % 2 else 0.0
            told = memory.update(frame(i / 10, boxes((10, 0), score=score), BOTH, EMPTY_FLOOR))
            if not i % 2:
                assert not (told.boxes.scores > 0.5).any()

    def test_of_two_robots_that_contradict_each_other_who_sees_through_the_place_is_believed(
        self,
    ) -> None:
        chances = in_turn({"R6": (EMPTY_FLOOR, Pose(10.0, -12.0, 1.2).matrix())})
        # R5 is believed until R6 has looked, and less with each frame that it insists.
        assert chances[0] > 0.8
        assert chances[1] < 0.5
        assert max(chances[3::2]) < 0.1
        assert max(chances[4:]) < 0.5

    def test_a_robot_that_shows_nothing_where_it_cannot_see_contradicts_nobody(self) -> None:
        for views in ({}, {"R6": (WALLED, Pose(-2.0, 0.0, 1.2).matrix())}):
            assert min(in_turn(views)) > 0.8

    def test_a_single_faint_box_is_not_remembered(self) -> None:
        memory = Memory(1.0)
        assert not len(memory.update(frame(0.0, boxes((5, 5), score=FAINTEST / 2))).ids)


class TestJumps:
    @pytest.mark.parametrize(
        "there",
        [Pose(60.0, 0.0, 1.2), Pose(0.0, 1.5, 1.2), Pose(0.0, 0.0, 1.2, yaw=np.radians(45.0))],
        ids=["far", "near", "turned"],
    )
    def test_an_ego_whose_pose_is_set_anew_forgets_rather_than_smears(self, there: Pose) -> None:
        memory = Memory(1.0)
        before = seen(memory)
        found = boxes((10.0, 0.0)).transformed(there.matrix())
        told = memory.update(frame(0.5, found, BOTH, WALLED, there.matrix()))
        assert told.boxes.centers == pytest.approx(found.centers)
        assert not set(told.ids.tolist()) & set(before.ids.tolist())

    @pytest.mark.parametrize("speed_m_s", [0.0, 3.0, 40.0])
    def test_an_ego_that_drives_turns_and_brakes_does_not(self, speed_m_s: float) -> None:
        memory = Memory(1.0)
        numbers = set()
        for at_s in (0.0, 0.1, 0.2, 0.5, 0.6):
            there = Pose(speed_m_s * at_s - 4.0 * at_s**2, 0.0, 1.2, yaw=at_s).matrix()
            told = memory.update(frame(at_s, boxes((10.0, 0.0)), BOTH, WALLED, there))
            numbers.add(told.ids[0])
        assert len(numbers) == 1

    def test_a_clock_that_was_put_back_forgets(self) -> None:
        memory = Memory(1.0)
        seen(memory)
        assert not len(memory.update(frame(-3.0, Boxes.empty(), BOTH, WALLED)).ids)


def about_places(one: Frame, *middles: tuple[float, float]) -> Frame:
    """The frame, where its helpers were asked about forklifts there only."""
    asked = boxes(*middles).transformed(invert(HERE))
    return replace(one, focused=one.helpers, places=encode_places(asked, 1.0))


class TestPlaces:
    """Frames in which robots were asked about the places of tracks only."""

    def test_they_move_a_track_as_a_whole_view_does(self) -> None:
        def after(*, places: bool) -> Remembered:
            memory = Memory(1.0)
            for i in range(20):
                one = frame(i / 10, boxes((10.0 + 0.1 * i, 0.0)), BOTH, WALLED)
                asks = places and i > 0
                told = memory.update(about_places(one, (10.0 + 0.1 * i, 0.0)) if asks else one)
            return told

        whole, places = after(places=False), after(places=True)
        assert places.boxes.centers[0] == pytest.approx(whole.boxes.centers[0], abs=0.05)
        assert places.velocities[0] == pytest.approx([1.0, 0.0], abs=0.2)

    def test_what_is_found_beside_tracks_counts_as_the_ego_s_own(self) -> None:
        def born(helpers: frozenset[str], *, places: bool = False) -> float:
            memory = Memory(1.0)
            seen(memory)
            found = Boxes.concatenate([boxes((10.0, 0.0)), boxes((3.0, 6.0))])
            one = frame(0.5, found, helpers, WALLED)
            told = memory.update(about_places(one, (10.0, 0.0)) if places else one)
            return float(told.boxes.scores[told.boxes.centers[:, 1] > 3.0].max())

        assert born(BOTH, places=True) == born(frozenset()) < born(BOTH) / 2

    def test_what_is_new_where_only_objects_were_sent_is_suspected_and_asked_about(self) -> None:
        memory, usual = Memory(1.0), Memory(1.0)
        for i in range(3):
            for one in (memory, usual):
                one.update(frame(i / 10, boxes((10.0, 0.0)), BOTH, WALLED))
        new = frame(0.3, boxes((10.0, 0.0), (4.0, 5.0)), BOTH, WALLED)
        told = [
            float(one.boxes.scores[one.boxes.centers[:, 1] > 3.0][0])
            for one in (memory.update(replace(new, objects_only=BOTH)), usual.update(new))
        ]
        assert told[0] < told[1] / 2
        # Its place is asked about, and where others show it, it is told of.
        assert (memory.suspected().boxes.centers[:, 1] > 3.0).any()
        for i in range(4, 12):
            shown = frame(i / 10, boxes((10.0, 0.0), (4.0, 5.0)), BOTH, WALLED)
            found = memory.update(about_places(shown, (10.0, 0.0), (4.0, 5.0)))
        assert found.boxes.scores[found.boxes.centers[:, 1] > 3.0][0] > 0.5

    def test_what_was_known_is_as_sure_where_only_objects_are_sent(self) -> None:
        chances = []
        for only in (frozenset[str](), BOTH):
            memory = Memory(1.0)
            for i in range(6):
                one = frame(i / 10, boxes((10.0, 0.0)), BOTH, WALLED)
                told = memory.update(replace(one, objects_only=only if i > 2 else frozenset()))
            chances.append(float(told.boxes.scores[0]))
        assert chances[0] == chances[1]

    def test_they_make_a_doubtful_track_surer_by_little(self) -> None:
        def told(*, places: bool) -> float:
            memory = Memory(1.0)
            memory.update(frame(0.0, boxes((10.0, 0.0), score=0.4), BOTH, WALLED))
            surer = frame(0.1, boxes((10.0, 0.0), score=0.95), BOTH, WALLED)
            surer = about_places(surer, (10.0, 0.0)) if places else surer
            return float(memory.update(surer).boxes.scores[0])

        assert 0.4 < told(places=True) < told(places=False) - 0.1

    def test_a_place_where_nothing_is_found_any_more_is_soon_empty(self) -> None:
        memory = Memory(1.0)
        seen(memory)
        for i in range(6):
            empty = frame(0.5 + i / 10, Boxes.empty(), BOTH, WALLED)
            told = memory.update(about_places(empty, (10.0, 0.0)))
        assert told.boxes.scores.max(initial=0.0) < 0.05

    def test_a_track_that_nobody_was_asked_about_lives_on(self) -> None:
        memory = Memory(1.0)
        before = seen(memory).boxes.scores[0]
        for i in range(6):
            empty = frame(0.5 + i / 10, Boxes.empty(), BOTH, WALLED)
            told = memory.update(about_places(empty, (3.0, 6.0)))
        assert told.boxes.scores[0] > before - 0.1

    def test_what_the_ego_sees_alone_of_a_track_not_asked_about_is_a_part(self) -> None:
        def after(*middles: tuple[float, float]) -> float:
            memory = Memory(1.0)
            seen(memory)
            beside = frame(0.5, boxes((10.3, 0.0), score=0.7), BOTH, WALLED)
            return float(memory.update(about_places(beside, *middles)).boxes.centers[0, 0])

        assert 10.0 <= after((3.0, 6.0)) < after((10.0, 0.0)) - 0.01

    def test_what_is_too_unlikely_to_be_told_is_asked_about_too(self) -> None:
        memory = Memory(1.0)
        memory.update(frame(0.0, boxes((10.0, 0.0), score=FAINTEST + 0.05), BOTH, WALLED))
        suspected = memory.suspected()
        assert suspected.boxes.scores[0] < 0.2
        assert len(within(places_of(suspected, 0.0, HERE), np.zeros((1, 3), np.float32))) == 1

    def test_they_are_asked_about_where_a_track_will_be(self) -> None:
        memory = Memory(1.0)
        told = seen(memory, 20, vx=1.0)
        there = told.boxes.centers[0, 0] + 2.0 * told.velocities[0, 0]
        places = places_of(memory.suspected(), 2.0, Pose(5.0, 0.0, 1.2, yaw=np.pi / 2).matrix())
        # Ahead of a sensor at x = 5 that looks along y, the world's x is to the right.
        point = np.array([[0.0, 5.0 - there, 0.0]], dtype=np.float32)
        assert within(places, point).all()
        beside = np.array([[0.0, 8.0 - there, 0.0]], dtype=np.float32)
        assert not within(places, beside).any()


def test_a_flood_of_false_boxes_is_bounded() -> None:
    memory, rng = Memory(1.0), np.random.default_rng(0)
    sure = boxes((0.0, 0.0))

    def flooded(i: int) -> Remembered:
        flood = boxes(*rng.uniform(50, 500, (1000, 2)).tolist(), score=0.3)
        return memory.update(frame(i / 10, Boxes.concatenate([flood, sure]), BOTH, WALLED))

    for i in range(5):
        flooded(i)
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        for i in range(5, 15):
            told = flooded(i)
            assert len(told.ids) <= MOST_TRACKS
        assert tracemalloc.get_traced_memory()[0] - before < 1_000_000
    finally:
        tracemalloc.stop()
    # What is sure is not lost in it.
    assert told.boxes.scores[0] > 0.8
    assert told.boxes.centers[0, :2] == pytest.approx([0.0, 0.0], abs=0.05)
    assert told.ids[0] <= 1001


def test_nothing_at_all_is_no_error() -> None:
    memory = Memory(1.0)
    for i in range(3):
        told = memory.update(Frame(i / 10, Boxes.empty()))
    assert len(told.boxes) == len(told.ids) == len(told.velocities) == len(told.ages_s) == 0


def test_headings_of_squares_are_alike_after_a_quarter_turn() -> None:
    memory = Memory(1.0)
    for i in range(10):
        one = boxes((5, 5), label="person")
        one.sizes[:] = (0.5, 0.5, 1.75)
        one.headings[:] = np.pi / 2 * (i % 2)
        told = memory.update(frame(i / 10, one))
    assert np.cos(4 * told.boxes.headings[0]) == pytest.approx(1.0, abs=0.01)
