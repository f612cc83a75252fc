from __future__ import annotations

import math
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ego_agent.analyze.grid import Grid
from ego_agent.analyze.merge import merge_nearby
from ego_agent.analyze.scene import analyze
from ego_agent.knowledge.model import RobotView
from ego_agent.plan.choices.scoring import Scorer
from swarm.arrays import Array, pack
from tests.support.ego_scenes import NOW_NS, knowledge, objects, snapshot, view


@pytest.mark.parametrize(
    ("robot", "reason"),
    [
        (view("R", 10, alive=False), "left"),
        (view("R", 10, duplicate=True), "two processes"),
        (view("R", 10, beacon=False, beacon_age_s=math.inf), "no beacon"),
        (view("R", 10, beacon_age_s=1.2), "1.2 s old"),
        (view("R", 10, beacon_age_s=math.nan), "old"),
        (view("R", 45.5), "45.5 m away, the range is 45.0 m"),
        (view("R", 10, sizes={}), "size"),
        (view("R", 10, sizes={"early": 0, "voxels": 5}), "size"),
        (view("R", 10, sizes={"early": 10**12}), "size"),
        (view("R", 10, sees=pack(np.ones((2, 3), np.float32))), "objects must be float32"),
        (view("R", 10, visible=[math.nan]), "visible_m holds NaN"),
        (view("R", 10, visible_m=Array("<f4", (3, 1), b"xx")), "needs 12 bytes"),
    ],
)
def test_a_robot_that_may_not_take_part_is_excluded_with_the_reason(
    robot: RobotView, reason: str
) -> None:
    unified = analyze(snapshot(view("E"), robot), knowledge())
    assert unified.candidates == ()
    assert reason in unified.excluded["R"]


def test_candidates_come_nearest_first_and_equal_distances_by_id() -> None:
    views = [view("E"), view("C", 20), view("B", 0, 5), view("A", 5), view("D", 44.9)]
    unified = analyze(snapshot(*views), knowledge())
    assert [c.robot for c in unified.candidates] == ["A", "B", "C", "D"]
    assert unified.candidates[2].distance_m == pytest.approx(20)
    assert unified.excluded == {}
    assert unified.ego.robot == "E"


def test_a_robot_without_a_usable_scene_may_take_part_and_shows_nothing() -> None:
    old = view("R", 10, sees=objects((20, 0, 50)), scene_age_s=6)
    none = view("S", 10, scene=False, scene_age_s=math.inf)
    unified = analyze(snapshot(view("E"), old, none), knowledge())
    assert [c.robot for c in unified.candidates] == ["R", "S"]
    assert not any(c.area.any() or c.evidence.any() for c in unified.candidates)


@pytest.mark.parametrize(
    ("ego", "reason"),
    [
        (None, "no beacon"),
        (view("E", beacon=False), "no beacon"),
        (view("E", beacon_age_s=2.0), "old"),
        (view("E", duplicate=True), "two processes"),
    ],
)
def test_an_ego_that_cannot_be_confirmed_has_no_candidates(
    ego: RobotView | None, reason: str
) -> None:
    views = [view("R", 10)] + ([ego] if ego else [])
    unified = analyze(snapshot(*views), knowledge())
    assert unified.candidates == ()
    assert reason in unified.excluded["E"]
    assert "ego" in unified.excluded["R"]


def test_the_ego_needs_no_liveliness_token_and_no_usable_scene() -> None:
    ego = view("E", alive=False, visible=[math.inf])
    unified = analyze(snapshot(ego, view("R", 10)), knowledge())
    assert [c.robot for c in unified.candidates] == ["R"]
    assert unified.excluded == {}
    assert not unified.ego.area.any()


def test_what_a_robot_shares_counts_for_egos_that_take_it() -> None:
    robot = view("R", 10)
    assert robot.beacon is not None
    told = replace(robot, beacon=msgspec.structs.replace(robot.beacon, shared=("early",)))
    known = knowledge()
    assert analyze(snapshot(view("E"), told), known).candidates[0].shared == {"early"}
    known.shares = False
    assert analyze(snapshot(view("E"), told), known).candidates[0].shared == frozenset()


def test_an_object_that_two_robots_see_is_one_with_evidence_of_both() -> None:
    ego = view("E", sees=objects((10, 0, 15), (0, 20, 60)))
    other = view("R", 20, sees=objects((11.2, 0, 30)))
    unified = analyze(snapshot(ego, other), knowledge())
    assert unified.objects.shape == (2, 3)
    order = np.argsort(unified.objects[:, 1])
    assert unified.ego.evidence[order] == pytest.approx([0.5, 1.0])
    assert unified.candidates[0].evidence[order] == pytest.approx([1.0, 0.0])
    assert unified.objects[order[0], 0] == pytest.approx((0.5 * 10 + 1.0 * 11.2) / 1.5)


def test_evidence_fades_with_the_age_of_the_scene() -> None:
    seen = objects((10, 0, 60))
    ages = {"A": 0.9, "B": 3.0, "C": 5.0}
    views = [view(r, 20, sees=seen, scene_age_s=age) for r, age in ages.items()]
    unified = analyze(snapshot(view("E"), *views), knowledge())
    evidence = [float(c.evidence[0]) for c in unified.candidates]
    assert evidence == pytest.approx([1.0, 0.5, 0.25])


def test_robots_are_no_objects_also_those_that_may_not_take_part() -> None:
    ego = view("E", sees=objects((20, 0.5, 90), (0.2, 0, 90), (60, 0, 90), (30, 0, 90)))
    unified = analyze(snapshot(ego, view("R", 20), view("far", 60)), knowledge())
    assert unified.objects[:, 0] == pytest.approx([30])


def test_objects_off_the_grid_or_without_points_do_not_count() -> None:
    ego = view("E", sees=objects((69.5, 0, 9), (70.5, 0, 9), (0, -71, 9), (5, 5, 0), (5, 9, -3)))
    unified = analyze(snapshot(ego), knowledge())
    assert unified.objects[:, 0] == pytest.approx([69.5])


def test_visible_area_is_a_fan_in_world_azimuth_around_the_robot() -> None:
    east_only = [20.0, 0, 0, 0, 0, 0, 0, 20.0]
    unified = analyze(snapshot(view("E", 3, 4), view("R", 13, 4, visible=east_only)), knowledge())
    area = unified.candidates[0].area
    rows, columns = np.nonzero(area)
    x, y = columns - 70 + 3, rows - 70 + 4
    assert area.shape == (140, 140)
    assert x.min() >= 13
    assert x.max() == 33
    assert np.abs(y - 4).max() == pytest.approx(20 / math.sqrt(2), abs=1)
    assert area.sum() == pytest.approx(math.pi * 20**2 / 4, rel=0.05)


@given(
    st.floats(-400, 400),
    st.floats(-400, 400),
    st.lists(st.floats(0, 2.0**100, width=32), max_size=40),
)
def test_a_visible_area_holds_only_cells_that_are_near_enough(
    x: float, y: float, visible: list[float]
) -> None:
    grid = Grid(7.0, -3.0, 30.0)
    area = grid.visible(x, y, np.array(visible, dtype=np.float32))
    assert area.shape == (60, 60)
    rows, columns = np.nonzero(area)
    distance = np.hypot(columns + 0.5 - 30 + 7 - x, rows + 0.5 - 30 - 3 - y)
    assert (distance <= max(visible, default=0.0) + 0.71).all()


def test_a_row_of_things_is_not_chained_into_one() -> None:
    xy = np.column_stack([np.arange(0.0, 20.0, 1.0), np.zeros(20)])
    group = merge_nearby(xy, np.ones(20), 1.5)
    for number in range(group.max() + 1):
        assert np.ptp(xy[group == number, 0]) <= 3.0


coordinates = st.floats(-20, 20, allow_nan=False)


@given(st.lists(st.tuples(coordinates, coordinates, st.floats(0.01, 1)), max_size=60))
def test_groups_are_compact_and_their_number_is_without_gaps(
    points: list[tuple[float, float, float]],
) -> None:
    table = np.array(points, dtype=np.float64).reshape(-1, 3)
    group = merge_nearby(table[:, :2], table[:, 2], 1.5)
    assert sorted(set(group.tolist())) == list(range(len(set(group.tolist()))))
    block = math.sqrt(2) * 0.5
    for number in set(group.tolist()):
        members = table[group == number, :2]
        assert np.hypot(*(members - members[0]).T).max() <= 2 * (1.5 + block)


def test_many_robots_that_see_the_same_things_agree_on_them() -> None:
    rng = np.random.default_rng(1)
    true = np.stack(np.meshgrid(np.arange(-40, 41, 8), np.arange(-40, 41, 8)), -1).reshape(-1, 2)
    things = np.column_stack([true + 3.7, np.full(len(true), 40)])
    views = []
    for i in range(20):
        noisy = things.copy()
        noisy[:, :2] += rng.uniform(-0.3, 0.3, true.shape)
        views.append(view(f"R{i}", i, sees=objects(*noisy.tolist())))
    unified = analyze(snapshot(view("E"), *views), knowledge())
    assert len(unified.objects) == len(true)
    assert all(c.evidence.sum() == pytest.approx(len(true)) for c in unified.candidates)


def test_measured_sizes_go_before_announced_ones_while_they_are_recent() -> None:
    known = knowledge()
    for size in (9_000, 11_000, 10_000):
        known.record_payload("R", "early", size, NOW_NS - 10**9)
    shot = snapshot(view("E"), view("R", 10))
    assert analyze(shot, known).candidates[0].sizes == {"early": 10_000, "late": 600}
    later = replace(shot, now_ns=NOW_NS + 60 * 10**9)
    assert analyze(later, known).candidates[0].sizes == {"early": 12_000, "late": 600}


wire_numbers = st.floats(width=32) | st.integers(0, 100).map(float)
tables = st.lists(st.lists(wire_numbers, min_size=9, max_size=9), max_size=5).map(
    lambda rows: pack(np.array(rows, dtype=np.float32).reshape(-1, 9))
)
places = st.floats(-60, 60) | st.sampled_from([1e300, -1e308, 0.0])
views = st.builds(
    view,
    st.sampled_from(["E", "A", "B", "C"]),
    places,
    places,
    sees=tables,
    visible=st.lists(wire_numbers, max_size=9),
    sizes=st.dictionaries(st.sampled_from(["early", "late", "?"]), st.integers(0, 10**20)),
    alive=st.booleans(),
    duplicate=st.booleans(),
    beacon=st.booleans(),
    beacon_age_s=st.floats(),
    scene=st.booleans(),
    scene_age_s=st.floats(),
)


@settings(max_examples=150, deadline=None)
@given(st.lists(views, max_size=5), st.floats())
def test_no_robot_can_make_analyze_fail(found: list[RobotView], capacity_bps: float) -> None:
    shot = snapshot(*found, capacity_bps=capacity_bps)
    unified = analyze(shot, knowledge())
    others = {v.robot for v in found} - {"E"}
    assert {c.robot for c in unified.candidates} | set(unified.excluded) - {"E"} == others
    assert np.isfinite(unified.objects).all()
    assert math.isfinite(unified.capacity_bps)
    for candidate in unified.candidates:
        assert candidate.sizes
        assert candidate.distance_m <= 45
        assert candidate.evidence.shape == (len(unified.objects),)
        assert ((candidate.evidence >= 0) & (candidate.evidence <= 1)).all()


def test_a_robot_that_claims_an_endless_distance_harms_nobody() -> None:
    shot = snapshot(view("E", sees=objects((5, 0, 40))), view("A", 1e300, -1e308))
    unified = analyze(shot, knowledge())
    assert len(unified.objects) == 1
    assert "range" in unified.excluded["A"]


def test_a_robot_whose_frames_stand_still_is_excluded() -> None:
    stuck = view("A", 10.0, 0.0)
    assert stuck.beacon is not None
    late = msgspec.structs.replace(stuck.beacon, sent_ns=NOW_NS, capture_ns=NOW_NS - 3_000_000_000)
    unified = analyze(snapshot(view("E"), replace(stuck, beacon=late)), knowledge())
    assert unified.candidates == ()
    assert "newest frame was 3.0 s old" in unified.excluded["A"]


@pytest.mark.parametrize("behind_s", [-1.0, 0.0, 0.5, 0.9])
@pytest.mark.parametrize("clock_off_s", [-30.0, 0.0, 30.0])
def test_a_robot_that_is_slow_to_read_its_frames_stays_a_candidate(
    behind_s: float, clock_off_s: float
) -> None:
    slow = view("A", 10.0, 0.0)
    assert slow.beacon is not None
    sent_ns = NOW_NS + round(clock_off_s * 1e9)
    captured_ns = sent_ns - round(behind_s * 1e9)
    behind = msgspec.structs.replace(slow.beacon, sent_ns=sent_ns, capture_ns=captured_ns)
    unified = analyze(snapshot(view("E"), replace(slow, beacon=behind)), knowledge())
    assert [c.robot for c in unified.candidates] == ["A"]


def test_what_a_robots_own_link_delivers_goes_into_the_scene() -> None:
    unified = analyze(
        snapshot(view("E"), view("A", 5.0, capacity_bps=2e6), view("B", 9.0)), knowledge()
    )
    assert [c.capacity_bps for c in unified.candidates] == [2e6, math.inf]


def test_a_living_robot_that_is_not_heard_counts_with_what_it_showed_last() -> None:
    ego = view("E", sees=objects((10, 0, 60)), visible=[10.0] * 8)
    heard = view("A", 5.0, sees=objects((10, 0, 60)))
    old = view("B", 20.0, sees=objects((30, 5, 60)), beacon_age_s=4.0, scene_age_s=9.0)
    unified = analyze(snapshot(ego, heard, old), knowledge())
    assert [c.robot for c in unified.candidates] == ["A"]
    assert [c.robot for c in unified.unheard] == ["B"]
    everyone = analyze(
        snapshot(ego, heard, view("B", 20.0, sees=objects((30, 5, 60)))), knowledge()
    )
    said = Scorer(unified, knowledge()).score(["A"], "early").quality
    assert said == pytest.approx(Scorer(everyone, knowledge()).score(["A"], "early").quality)
    assert said < 0.8


def test_living_robots_that_nothing_is_known_of_take_their_part_of_the_quality() -> None:
    strangers = [view(r, beacon=False, scene=False, beacon_age_s=math.inf) for r in ("B", "C")]
    unified = analyze(snapshot(view("E"), view("A", 5.0), *strangers), knowledge())
    assert unified.unknown == 2
    scorer = Scorer(unified, knowledge())
    assert scorer.share([0, 1]) == pytest.approx(0.5)
    assert scorer.share([0]) < 0.5


@pytest.mark.parametrize(
    "others",
    [
        [view("A", 5.0, beacon_age_s=3.0)],
        [view("A", beacon=False, scene=False, beacon_age_s=math.inf)],
        [view("A", 5.0, sizes={})],
        [view("A", 5.0, beacon_age_s=3.0), view("B", 9.0, beacon_age_s=math.inf, scene=False)],
    ],
)
def test_an_ego_that_hears_none_of_the_living_robots_knows_no_quality(
    others: list[RobotView],
) -> None:
    unified = analyze(snapshot(view("E"), *others), knowledge())
    assert Scorer(unified, knowledge()).score((), "early").quality == 0.0


@pytest.mark.parametrize(
    "other", [view("A", 5.0, alive=False), view("A", 90.0), view("A", 90.0, beacon_age_s=5.0)]
)
def test_robots_that_have_left_or_are_out_of_range_take_nothing(other: RobotView) -> None:
    unified = analyze(snapshot(view("E"), other), knowledge())
    assert Scorer(unified, knowledge()).score((), "early").quality == pytest.approx(1.0)


def test_an_ego_whose_own_robot_is_off_duty_is_blind() -> None:
    ego = replace(view("E"), off_duty="lead")
    unified = analyze(snapshot(ego, view("A", 5.0)), knowledge())
    assert "taken off duty by lead" in unified.excluded["E"]
    assert Scorer(unified, knowledge()).score((), "early").quality == 0.0


def test_a_beacon_that_queued_says_how_long_it_was_on_its_way() -> None:
    queued = replace(view("A", 5.0, beacon_age_s=4.1), delay_s=4.0)
    unified = analyze(snapshot(view("E"), queued), knowledge())
    assert "it was 4.0 s on its way" in unified.excluded["A"]
