"""Ways to share a drive: who is asked when, what that brings, and how well objects are followed."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from perception.detector.weight_files import has_weights
from perception.types import Boxes
from research.evaluation.ways.drive import Driven
from research.evaluation.ways.etsi import EtsiDriven, message_bytes
from research.evaluation.ways.measure import SETTLED_FRAMES, Measured, Silence, measure
from research.evaluation.ways.run import EVERYONE, OURS, best_static, compare, floors, report, ways
from research.evaluation.ways.tracking import CUT_OFF_M, Following
from research.evaluation.ways.way import Way
from swarm.errors import EvaluationError

needs_weights = pytest.mark.skipif(not has_weights("factory"), reason="no weights: make train")
NEAREST = ("R2", "R3", "R4")


def places(*rows: tuple[float, float]) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    return np.array(rows, dtype=np.float64).reshape(-1, 2)


class TestFollowing:
    def test_all_right(self) -> None:
        following = Following()
        for x in range(10):
            following.add(
                places((x, 0), (x, 9)), np.array([1, 2]), places((x, 0), (x, 9)), ("a", "b")
            )
        assert following.figures(10.0) == {
            "mota": 1.0,
            "idf1": 1.0,
            "identity_switches_per_track_minute": 0.0,
            "gospa_m": 0.0,
        }

    def test_missed_and_false(self) -> None:
        following = Following()
        following.add(places((50, 0)), np.array([1]), places((0, 0), (5, 0)), ("a", "b"))
        assert (following.missed, following.false) == (2, 1)
        figures = following.figures(10.0)
        assert figures["mota"] == pytest.approx(1 - 3 / 2)
        assert figures["gospa_m"] == pytest.approx(math.sqrt(3 * CUT_OFF_M**2 / 2))

    def test_an_identity_that_changes_counts_once(self) -> None:
        following = Following()
        for track in (1, 1, 1, 7, 7, 7):
            following.add(places((0, 0)), np.array([track]), places((0, 0)), ("a",))
        assert following.switches == 1
        figures = following.figures(1.0)
        assert figures["identity_switches_per_track_minute"] == pytest.approx(10.0)
        assert figures["idf1"] == pytest.approx(0.5)

    def test_who_showed_it_before_goes_on_to_where_another_is_nearer(self) -> None:
        following = Following()
        following.add(places((0, 0)), np.array([1]), places((0, 0)), ("a",))
        following.add(places((0.3, 0), (0.1, 0)), np.array([1, 2]), places((0, 0)), ("a",))
        assert (following.switches, following.false) == (0, 1)

    def test_drives_have_objects_of_their_own(self) -> None:
        whole = Following()
        for drive, track in enumerate((1, 2)):
            one = Following()
            for _ in range(4):
                one.add(places((0, 0)), np.array([track]), places((0, 0)), ("a",))
            whole.take_up(one, drive)
        assert whole.switches == 0
        assert whole.figures(10.0)["idf1"] == 1.0

    def test_nothing_at_all(self) -> None:
        following = Following()
        following.add(places(), np.zeros(0, np.int64), places(), ())
        assert following.figures(10.0)["mota"] == 1.0


class TestWay:
    def test_everybody_together(self) -> None:
        way = Way("w", (("early", 5.0),))
        asked = [set(way.asked(n, NEAREST, 10.0)) for n in range(4)]
        assert asked == [set(NEAREST), set(), set(NEAREST), set()]

    def test_the_near_ones_otherwise_than_the_others(self) -> None:
        way = Way("w", (("early", 10.0), ("late", 5.0)))
        assert way.asked(0, NEAREST, 10.0) == {"R2": "early", "R3": "late", "R4": "late"}
        assert way.asked(1, NEAREST, 10.0) == {"R2": "early"}

    def test_in_turn(self) -> None:
        way = Way("w", (("early", 5.0),), in_turn=True)
        assert [tuple(way.asked(n, NEAREST, 10.0)) for n in range(2)] == [("R2", "R4"), ("R3",)]

    def test_a_silence(self) -> None:
        way = Way("w", (("early", 10.0),), silent=(5, 2))
        assert [bool(way.asked(n, NEAREST, 10.0)) for n in range(5)] == [True] * 3 + [False] * 2

    def test_names_are_unique_and_the_compared_ones_among_them(self) -> None:
        names = [way.name for way in ways()]
        assert len(names) == len(set(names))
        assert {EVERYONE, OURS} < set(names)


@needs_weights
def test_memory_is_worth_more_the_less_often_robots_send() -> None:
    driven = Driven(floors(1, SETTLED_FRAMES + 12)[0])

    def of(way: Way) -> Measured:
        return measure(driven, way)

    often = of(Way("often", (("early", 10.0),)))
    rarely = of(Way("rarely", (("early", 2.0),)))
    without = of(Way("without", (("early", 2.0),), memory=False))
    assert 0 < rarely.bytes == without.bytes < 0.35 * often.bytes
    assert rarely.tally.precision().ap_50 > without.tally.precision().ap_50 + 0.05
    assert rarely.tally.precision().ground_truth == often.tally.precision().ground_truth > 0
    assert rarely.following.figures(10.0)["idf1"] > without.following.figures(10.0)["idf1"]


def boxes(*middles: float) -> Boxes:
    many = len(middles)
    centers = np.array([(x, 0.0, 1.0) for x in middles]).reshape(-1, 3)
    return Boxes(centers, np.ones((many, 3)), np.zeros(many), np.ones(many), ("person",) * many)


def test_what_everybody_lost_is_counted_once_a_silence() -> None:
    # Before the silence all three are told of; then only the first is shown, and at the end the
    # second one's place is remembered, and the third one's is not any more.
    truth = {name: np.array([x, 0.0, 1.0]) for name, x in (("a", 0.0), ("b", 5.0), ("c", 9.0))}
    measured = Measured()
    silence = Silence(measured)
    for _ in range(2):
        silence.add(-1, 3, boxes(0, 5, 9), boxes(0, 5, 9), truth)
        for place in range(3):
            shown = boxes(0) if place == 1 else boxes()
            silence.add(place, 3, shown, boxes(0, 5.4, 9.6), truth)
    assert (measured.lost, measured.found_again) == (4, 2)


def rows() -> list[dict[str, object]]:
    def row(name: str, ap_70: float, size: float, *, static: bool) -> dict[str, object]:
        return {
            "way": name,
            "ap_70": ap_70,
            "bytes_per_frame": size,
            "bytes_ratio": size / 10.0,
            "static": static,
            "delivered_difference": ap_70 - 0.9,
            "delivered_interval": [0.0, 0.0],
            "lost": 8,
            "found_again": 0 if "no-memory" in name else 6,
            **dict.fromkeys(("mota", "idf1", "gospa_m", "identity_switches_per_track_minute"), 0.5),
        }

    return [
        row(EVERYONE, 0.9, 10.0, static=False),
        row(OURS, 0.94, 2.0, static=False),
        row("early-10hz", 0.97, 10.0, static=True),
        row("early-2hz", 0.938, 4.0, static=True),
        row("late-10hz", 0.7, 1.0, static=True),
        row("silence", 0.8, 5.0, static=False),
        row("silence-no-memory", 0.6, 5.0, static=False),
    ]


def test_the_best_static_way_delivers_as_much_for_the_fewest_bytes() -> None:
    assert best_static(rows(), 0.94)["way"] == "early-2hz"
    assert best_static(rows(), 0.95)["way"] == "early-10hz"
    assert best_static(rows(), 0.99)["way"] == "early-10hz"


def test_the_report_tells_figures_beside_their_controls(tmp_path: Path) -> None:
    path = tmp_path / "eval" / "ways.json"
    figures = report({"rows": rows(), "drives": 1, "frames": 1}, {"noise": {"rows": []}}, path)
    assert figures["bytes_ratio"] == 0.2
    assert figures["bytes_ratio_best_static"] == 0.5
    assert (figures["lost_found_ratio"], figures["lost_found_ratio_no_memory"]) == (0.75, 0.0)
    written = json.loads(path.read_text())
    assert written["noise"] == {"rows": []}
    assert written["way"] == OURS
    assert written["machine"]["cores"] >= 1


def test_ways_are_compared_with_everyone() -> None:
    with pytest.raises(EvaluationError, match=EVERYONE):
        compare(floors(1, 20), [Way("alone")], 1)


@needs_weights
def test_stations_tell_by_the_rules_and_the_ego_holds_what_it_heard() -> None:
    (drive,) = floors(1, 3)
    told, less = EtsiDriven(drive), EtsiDriven(drive, mitigates=True)
    asked = dict.fromkeys(told.nearest, "cpm")
    frames = [told.fused(frame, asked, 0.1) for frame in told.frames]
    # Everybody begins with a message; what was told is held while less is told.
    assert all(size >= message_bytes([]) for size in frames[0].bytes.values())
    assert frames[0].helpers
    assert all(frame.helpers >= frames[0].helpers for frame in frames)
    sizes = [sum(frame.bytes.values()) for frame in frames]
    assert sizes[2] < sizes[0]
    fewer = [sum(less.fused(frame, asked, 0.1).bytes.values()) for frame in less.frames]
    assert 0 < sum(fewer) < sum(sizes)
    # Of a message that does not come nothing is held.
    lonely = EtsiDriven(drive)
    assert not lonely.fused(drive.first, {}, 0.1).helpers
