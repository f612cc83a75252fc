"""Control windows: which scenarios, what an ego would know, what a choice brings, what is best."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from msgspec import msgpack

from ego_agent.analyze.scene import analyze
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.compute import ComputeModel, Work, packaged_compute
from ego_agent.knowledge.control_share import WELL_BPS
from ego_agent.knowledge.objective import Objective
from network_controller.profiles import Fixed
from perception.fusion.registry import fusion_names
from research.evaluation.policies.work_items import knowledge_of
from research.evaluation.windows import announcements, links
from research.evaluation.windows.choice import ALONE, Choice, Outcome
from research.evaluation.windows.fused import packed_frames, unpacked_frames
from research.evaluation.windows.measure import (
    NotMeasuredError,
    Window,
    candidates_of,
    packed,
    unpacked,
)
from research.evaluation.windows.scenarios import (
    SURROGATE_SEEDS,
    Scenario,
    chosen,
    factory_suite,
    recorded_suite,
)
from research.evaluation.windows.search import best, every_choice, explore, held_out_regret
from research.evaluation.windows.timing import Timing
from research.evaluation.windows.traffic import HEADERS, control_bps
from research.training.plans import TEST_SEEDS
from swarm.errors import CoAdaptError, EvaluationError
from swarm.messages import encode
from worlds.cooperative.fusing import fuse_frame
from worlds.cooperative.judging import tallied
from worlds.sample import data_folder

pytestmark = pytest.mark.slow

KNOWLEDGE = Knowledge(Objective(lambda_cost=1.0))
SMALL = Scenario("small", 3, links.shift(), TEST_SEEDS.start + 555_555, first_frame=40)


def outcome(ap_70: float, size: float, halves: tuple[float, float] | None = None) -> Outcome:
    return Outcome(ap_70, ap_70, ap_70, size, 4, 20, halves)


def test_the_suite_is_what_docs_promise() -> None:
    suite = factory_suite()
    sizes = [scenario.robots for scenario in suite if scenario.robots <= 12]
    assert len(sizes) >= 24
    assert set(range(3, 13)) <= set(sizes)
    assert [s.robots for s in suite if s.robots > 12] == [20, 30, 40, 50]
    assert {scenario.pose_noise_m for scenario in suite} == {0.0, 0.2}
    assert len({scenario.name for scenario in suite}) == len(suite)
    assert len({scenario.seed for scenario in suite}) == len(suite)
    assert all(scenario.seed in TEST_SEEDS for scenario in suite)
    assert not any(scenario.seed in SURROGATE_SEEDS for scenario in suite)
    assert sum(scenario.expectation is not None for scenario in suite) == 3
    for scenario in suite:
        assert 0 <= scenario.ego < scenario.robots
        last = scenario.sampled_frames(scenario.windows - 1)[-1]
        assert scenario.first_frame <= last < scenario.open().frame_count


def test_each_window_is_another_part_of_the_day() -> None:
    rates = [replace(SMALL, link=links.shift()).capacity_bps(window) / 1e6 for window in range(4)]
    assert [round(rate) for rate in rates] == pytest.approx([57, 22, 5, 5], abs=1)
    busy = replace(SMALL, link=links.shift(telemetry=True))
    assert busy.capacity_bps(0) / 1e6 == pytest.approx(rates[0] * 0.15)
    assert links.low_tier_with_telemetry().rate_bps(3) == pytest.approx(0.75e6)


def test_recorded_links_are_scenarios_where_there_are_any(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "traces"
    folder.mkdir()
    # 1.2 Mbit/s for two windows, then 0.6; in the first window four seconds of 1.5 and a pause.
    times = [*range(8, 4_001, 8), *range(5_010, 10_001, 10), *range(10_020, 15_001, 20)]
    (folder / "train.down").write_text("".join(f"{ms}\n" for ms in times))
    monkeypatch.setenv("COADAPT_DATA", str(tmp_path))
    (link,) = links.recorded()
    (folder / "README").write_text("no recording")
    assert len(links.recorded()) == 1
    assert link.rate_bps(7.0) == pytest.approx(1.2e6, rel=0.01)
    assert link.rate_bps(3.5) == pytest.approx(1.5e6, rel=0.01)
    assert link.rate_bps(4.5) == 1, "a trace moves inside a window"
    scenario = factory_suite()[-1]
    assert scenario.link.name == "train.down"
    assert scenario.capacity_bps(0) == pytest.approx(1.2e6, rel=0.01)
    assert scenario.capacity_bps(2) == pytest.approx(0.6e6, rel=0.01)
    assert scenario.known_bps(2) == pytest.approx(1.2e6, rel=0.01), (
        "the window to come is not known"
    )
    assert scenario.known_bps(0) == pytest.approx(0.6e6, rel=0.01)


@pytest.mark.data
def test_all_recorded_links_can_be_read() -> None:
    if data_folder(Path("traces")) is None:
        pytest.skip("no recorded links: set COADAPT_DATA to a folder with traces/")
    assert len(links.recorded()) >= 4
    assert all(link.rate_bps(5.0) >= 1 for link in links.recorded())


def test_a_recorded_world_gives_each_vehicle_a_scenario(opv2v_dir: Path) -> None:
    suite = recorded_suite(opv2v_dir)
    assert [(s.ego, s.pose_noise_m) for s in suite] == [(0, 0.0), (1, 0.0), (0, 0.2), (1, 0.2)]
    for scenario in suite:
        frames = [f for w in range(scenario.windows) for f in scenario.sampled_frames(w)]
        assert len(set(frames)) == len(frames)
        assert max(frames) < scenario.open().frame_count


def test_a_world_with_one_robot_or_none_is_refused(opv2v_dir: Path, tmp_path: Path) -> None:
    alone = tmp_path / "alone"
    alone.mkdir()
    for path in opv2v_dir.iterdir():
        if path.name != "311":
            (alone / path.name).symlink_to(path)
    with pytest.raises(EvaluationError, match="has 1 robot; a decision needs at least 2"):
        recorded_suite(alone)
    with pytest.raises(CoAdaptError):
        recorded_suite(tmp_path / "nothing")
    half = tmp_path / "half"
    (half / "monday").mkdir(parents=True)
    (half / "tuesday").symlink_to(opv2v_dir)
    with pytest.raises(EvaluationError, match="monday is no whole recording: it has no data_prot"):
        recorded_suite(half)


def test_a_recording_that_has_changed_is_another(opv2v_dir: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(opv2v_dir, copy)
    before = recorded_suite(copy)[0].setting()
    assert recorded_suite(copy)[0].setting() == before
    scan = next(copy.rglob("*.pcd"))
    scan.write_bytes(scan.read_bytes() + b"\n")
    assert recorded_suite(copy)[0].setting() != before


def test_keys_are_the_same_in_every_process() -> None:
    code = (
        "from research.evaluation.policies.work_items import WorkItem\n"
        "from research.evaluation.windows.scenarios import factory_suite\n"
        "items = [WorkItem(s, 1, ('early', 'late')) for s in factory_suite()]\n"
        "print([(p.heard_key(), p.frames_key()) for p in items])"
    )
    said = {
        subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for seed in ("1", "2", "3")
    }
    assert len(said) == 1


def test_a_folder_of_recordings_is_compared_as_one(opv2v_dir: Path, tmp_path: Path) -> None:
    for name in ("monday", "tuesday"):
        (tmp_path / name).symlink_to(opv2v_dir)
    names = [scenario.name for scenario in recorded_suite(tmp_path)]
    assert len(set(names)) == len(names) == 8
    assert names[0].startswith("monday-")


def test_unknown_scenarios_are_named() -> None:
    with pytest.raises(EvaluationError, match="scenario 'moon' is not known; allowed: redundant"):
        chosen(factory_suite(), ["moon"])


def test_an_outcome_is_what_an_experiment_on_the_same_frames_finds() -> None:
    window = Window(SMALL, 1)
    others = tuple(robot for robot in window.world.robots if robot != window.ego)
    mine = window.outcome(Choice(others, "late"))
    theirs = tallied(window.world, "late", window.ego, frames=SMALL.sampled_frames(1)).precision()
    assert (mine.ap_30, mine.ap_50, mine.ap_70) == (theirs.ap_30, theirs.ap_50, theirs.ap_70)
    assert mine.ground_truth == theirs.ground_truth
    assert mine.bytes_per_frame == pytest.approx(theirs.bytes_per_robot_frame * len(others))
    assert window.outcome(Choice((), ALONE)).bytes_per_frame == 0
    assert unpacked(packed(window.outcomes)) == window.outcomes
    assert window.outcome(Choice(others, "late")).delivered is None, "no time was played"


def test_what_was_fused_once_is_known_on_every_link_and_machine() -> None:
    timing = Timing(packaged_compute(), control_bps=10_000.0)
    wide = Window(SMALL, 0, timing=timing)
    others = tuple(sorted(robot for robot in wide.world.robots if robot != wide.ego))
    choices = list(every_choice(others, ("late",)))
    outcomes = {choice: wide.outcome(choice) for choice in choices}
    everyone, alone = Choice(others, "late"), Choice((), ALONE)
    delivered = outcomes[everyone].arrived
    assert delivered.ap_70 == outcomes[everyone].ap_70
    assert delivered.halves == outcomes[everyone].halves
    assert delivered.bytes_per_frame == pytest.approx(outcomes[everyone].bytes_per_frame, rel=0.05)
    assert (delivered.in_time_ratio, delivered.fused_ratio) == (1.0, 1.0)
    late, single = (timing.compute.work("factory", name) for name in ("late", "single"))
    assert delivered.ego_ms_per_frame == pytest.approx(late.ego_ms(2))
    assert outcomes[alone].arrived.ego_ms_per_frame == pytest.approx(single.fixed_ms)

    known = unpacked_frames(msgpack.decode(msgpack.encode(packed_frames(wide.known))))
    thin = replace(SMALL, link=links.Link("thin", Fixed(12_000)))
    narrow = Window(thin, 0, known, timing=timing, measures=False)
    assert narrow.outcome(everyone).ap_70 == outcomes[everyone].ap_70
    nothing = narrow.outcome(everyone).arrived
    assert (nothing.ap_70, nothing.in_time_ratio) == (outcomes[alone].ap_70, 0.0)
    assert nothing.ego_ms_per_frame == pytest.approx(late.fixed_ms)
    # A machine on which nobody encodes in time.
    slow = Work(encode_ms=300, fixed_ms=20, add_ms=1)
    model = ComputeModel("slow", {"factory": {"intermediate": slow, "single": slow}})
    tired = Window(SMALL, 0, known, timing=Timing(model), measures=False)
    assert tired.outcome(everyone).arrived.ap_70 == outcomes[alone].ap_70
    with pytest.raises(NotMeasuredError):
        narrow.outcome(Choice(others, "early"))


def test_of_half_a_robots_frames_those_in_time_are_fused() -> None:
    """One robot's answers take the link three frames, so that it is in some frames only."""
    window = Window(SMALL, 0)
    (robot, *_) = (robot for robot in window.world.robots if robot != window.ego)
    choice = Choice((robot,), "early")
    size = window.outcome(choice).bytes_per_frame
    link = links.Link("half", Fixed(round(8 * size / 0.19 * HEADERS)))
    timed = Window(replace(SMALL, link=link), 0, window.known, timing=Timing(packaged_compute()))
    outcome = timed.outcome(choice)
    with_robot, alone = window.outcome(choice).ap_70, timed.outcome(Choice((), ALONE)).ap_70
    assert 0.1 < outcome.arrived.in_time_ratio < 0.5
    assert outcome.arrived.ap_70 not in (with_robot, alone)
    assert outcome.arrived.bytes_per_frame < 0.6 * outcome.bytes_per_frame
    came = outcome.arrived
    assert came.capacity_bps == pytest.approx(link.rate_bps(0.0))
    assert came.helping_ms_per_frame > 0.0
    price = KNOWLEDGE.objective.cost(
        came.bytes_per_frame, came.capacity_bps, came.helping_ms_per_frame * 1e-3, 10.0
    )
    assert outcome.value(KNOWLEDGE.objective) == pytest.approx(came.ap_70 - price)


def test_beacons_and_scenes_take_what_the_ego_grants() -> None:
    window = Window(SMALL, 0)
    messages = announcements.heard(window.world, 40, window.ego, {"late": window.fusion("late")})
    told = sum(
        8 * (10 * len(encode(beacon)) + 2 * len(encode(scene)))
        for robot, (beacon, scene) in messages.items()
        if robot != window.ego
    )
    assert control_bps(announcements.snapshot(window.ego, messages, 50e6)) == told > 10_000
    # Of 100 kbit/s more than a fifth: what two need to be known well.
    granted = control_bps(announcements.snapshot(window.ego, messages, 100e3))
    assert granted == pytest.approx(2 * WELL_BPS, rel=0.01)


def test_what_an_ego_knows_is_what_robots_would_send() -> None:
    scenario = replace(SMALL, pose_noise_m=0.2)
    window = Window(scenario, 0)
    fusions = {"late": window.fusion("late")}
    messages = announcements.heard(window.world, 40, window.ego, dict(fusions), 0.2)
    messages = announcements.unpacked(announcements.packed(messages))
    beacon, scene = messages["R2"]
    true = window.world.pose("R2", 40)
    assert 0 < abs(beacon.pose[0] - true.x) < 1.0
    assert scene.frame == 38, "descriptions come less often than beacons"
    assert beacon.sizes["late"] > 0
    assert not messages[window.ego][0].sizes
    assert messages[window.ego][0].pose[0] == pytest.approx(window.world.pose("R1", 40).x)
    unified = analyze(
        announcements.snapshot(window.ego, messages, 5e6),
        knowledge_of(fusion_names("factory"), SMALL),
    )
    assert set(candidates_of(unified)) == {"R2", "R3"}
    far = announcements.heard(window.world, 40, window.ego, dict(fusions), reach_m=0.1)
    assert not far["R2"][0].sizes


def test_announced_sizes_are_of_what_the_ego_asks_for() -> None:
    window = Window(SMALL, 0)
    fusions = {name: window.fusion(name) for name in ("intermediate", "intermediate-sparse")}
    messages = announcements.heard(window.world, 25, window.ego, dict(fusions))
    for name, fusion in fusions.items():
        fused = fuse_frame(window.world, 0, window.ego, ["R2"], fusion)
        own = window.world.scan(window.ego, 0)
        ask = fusion.begin(own.points, own.pose.matrix()).ask()
        assert messages["R2"][0].sizes[name] == fused.bytes["R2"] - ask.size()


def test_every_set_with_every_algorithm_once() -> None:
    choices = list(every_choice(("R3", "R2", "R4"), ("early", "late")))
    assert len(choices) == len(set(choices)) == 1 + 7 * 2
    assert Choice.of(["R1", "R4", "R2"], "late", "R1") in choices
    assert Choice.of(["R1"], "late", "R1") == Choice((), ALONE)


def test_the_oracle_takes_the_best_that_the_link_carries() -> None:
    a, b, alone = Choice(("R2",), "early"), Choice(("R2",), "late"), Choice((), ALONE)
    known = {a: outcome(0.89, 20_000), b: outcome(0.88, 400), alone: outcome(0.5, 0)}
    assert best(known, 55e6, KNOWLEDGE) == b, "20 kB must bring 0.02"
    assert best({**known, a: outcome(0.95, 20_000)}, 55e6, KNOWLEDGE) == a
    assert best({**known, a: outcome(0.95, 20_000)}, 1e6, KNOWLEDGE) == b
    assert best(known, 1e3, KNOWLEDGE) == alone
    only_late = Knowledge(Objective(lambda_cost=1.0), ["late"])
    assert best({**known, a: outcome(0.95, 20_000)}, 55e6, only_late) == b


def test_luck_is_no_merit_of_the_oracle() -> None:
    lucky, steady = Choice(("R2",), "early"), Choice(("R3",), "early")
    known = {lucky: outcome(0.75, 0, (1.0, 0.5)), steady: outcome(0.7, 0, (0.7, 0.7))}
    # One half of the frames finds the lucky one best, and is judged by the other.
    regret = held_out_regret(known, known[steady], 55e6, KNOWLEDGE)
    assert regret == pytest.approx(((0.5 - 0.7) + (0.7 - 0.7)) / 2)
    assert held_out_regret(known, outcome(0.7, 0), 55e6, KNOWLEDGE) is None


def test_the_search_beyond_exhaustion_measures_growing_sets_and_neighbours() -> None:
    class Counted(Window):
        def _measure(self, choice: Choice) -> Outcome:
            wanted = {"R3", "R5"}
            hits = len(wanted & set(choice.participants))
            return outcome(0.5 + 0.2 * hits, 1_000.0 * len(choice.participants))

    scenario = replace(SMALL, robots=8, name="eight")
    window = Counted(scenario, 0)
    knowledge = Knowledge()
    messages = announcements.heard(window.world, 40, window.ego, {"late": window.fusion("late")})
    scene = analyze(announcements.snapshot(window.ego, messages, 55e6), knowledge)
    assert len(candidates_of(scene)) > 5
    wanted = [Choice(("R3", "R5", "R6"), "late")]
    considered = explore(window, scene, knowledge, wanted)
    assert best(considered, 55e6, knowledge).participants == ("R3", "R5")
    assert {choice.algorithm for choice in considered} >= set(knowledge.algorithms)
    assert len(considered) < 2 ** len(candidates_of(scene))
    # What was measured for others plays no part.
    window.outcome(Choice(("R2", "R3", "R5", "R7"), "early"))
    assert explore(window, scene, knowledge, wanted) == considered
    blank = Window(scenario, 0, measures=False)
    with pytest.raises(NotMeasuredError):
        explore(blank, scene, knowledge, wanted)
