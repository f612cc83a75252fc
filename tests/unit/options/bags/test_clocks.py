"""Bags as they come from robots: mixed up, by clocks that differ, still growing, cut off."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from options.bags.world import BagWorld
from swarm.errors import WorldError
from swarm.geometry import Pose
from tests.support.bag_files import CLOUD, MOUNT, Log, cloud, ns, plain_log
from worlds.registry import open_world

TIMES = np.arange(16) / 10
STORAGES = {"mcap": ".mcap", "sqlite3": ".db3"}


def times_shown(world: BagWorld, robot: str) -> list[float]:
    """What a robot's scans say of when they were taken, frame by frame."""
    scans = [world.scan(robot, frame).points for frame in range(world.frame_count)]
    return [round(float(points[0, 0]), 3) for points in scans if len(points)]


def shuffled(order: list[int]) -> Log:
    """A log in which scans are recorded in another order than that in which they were taken."""
    log = Log().drive(TIMES).tf(0, MOUNT, static=True)
    for at, index in enumerate(order):
        taken = TIMES[index]
        message = cloud(ns(taken), np.array([[taken, 1, 1]]))
        log.add("/points", CLOUD, ns(TIMES[at]), message)
    return log


@pytest.mark.stumble(
    "header stamps out of order show 4 of 16 scans, silently", command="make up WORLD=bag DATA=dir"
)
@pytest.mark.parametrize(
    "order",
    [
        [3, 2, 1, 0, 7, 6, 5, 4, 11, 10, 9, 8, 15, 14, 13, 12],
        [8, 9, 10, 11, 12, 13, 14, 15, 0, 1, 2, 3, 4, 5, 6, 7],
        list(reversed(range(16))),
    ],
)
def test_scans_are_shown_in_the_order_of_their_headers(tmp_path: Path, order: list[int]) -> None:
    shuffled(order).write(tmp_path / "R1")
    (tmp_path / "world.toml").write_text("[robots.R1]\nclock_offset_s = 0\n")
    world = BagWorld(tmp_path)
    assert world.frame_count == 16
    assert times_shown(world, "R1") == TIMES.tolist()
    behind = sum(index < max(order[: at + 1]) for at, index in enumerate(order))
    assert world.timings[0].disordered == behind
    (note,) = world.notes
    assert note.startswith(f"{behind} of 16 scans of R1 were recorded out of order")


def later(folder: Path, robot: str, by_s: float, recorded_s: float) -> None:
    """A robot's bag whose stamps are later by a time, and its recording by another one."""
    log = plain_log(TIMES + by_s)
    moved = round((recorded_s - by_s) * 1e9)
    log.rows = [(topic, kind, at + moved, message) for topic, kind, at, message in log.rows]
    log.write(folder / robot)


@pytest.mark.stumble(
    "clocks of two robots a second apart show 4 of 16 scans, silently",
    command="make up WORLD=bag DATA=dir",
)
@pytest.mark.parametrize("apart_s", [1.0, -1.0, 3600.0])
def test_clocks_that_differ_by_one_recorders_time_are_refused_with_the_remedy(
    tmp_path: Path, apart_s: float
) -> None:
    later(tmp_path, "R1", 0, 0)
    later(tmp_path, "R2", apart_s, 0)
    words = f"clocks of R1 and R2 in .* are {abs(apart_s):.3f} s apart.*clock_offset_s = {apart_s}"
    with pytest.raises(WorldError, match=words):
        BagWorld(tmp_path)
    (tmp_path / "world.toml").write_text(f"[robots.R2]\nclock_offset_s = {apart_s}\n")
    world = BagWorld(tmp_path)
    assert world.frame_count == 16
    assert times_shown(world, "R1") == TIMES.tolist()
    assert times_shown(world, "R2") == pytest.approx((TIMES + apart_s).tolist(), abs=1e-3)
    for frame in (0, 7, 15):
        assert world.pose("R1", frame) == world.scan("R1", frame).pose
        assert world.pose("R2", frame).x - apart_s == pytest.approx(world.pose("R1", frame).x)
        assert world.scan("R2", frame).velocity == pytest.approx((1, 0, 0))


@pytest.mark.parametrize("by", ["odometry", "tf"])
def test_a_slow_driver_is_no_clock(tmp_path: Path, by: str) -> None:
    """Robots with recorders of their own, of which one hears its scans late, and nothing else."""
    plain_log(TIMES).write(tmp_path / "R1")
    slow = Log().scans(TIMES)
    slow.rows = [(topic, kind, at + ns(0.6) - ns(0), raw) for topic, kind, at, raw in slow.rows]
    if by == "odometry":
        slow.drive(TIMES)
    else:
        for time in TIMES:
            slow.tf(time, {("odom", "base_link"): Pose(time, 0, 0)})
    slow.tf(0, MOUNT, static=True).write(tmp_path / "R2")
    world = BagWorld(tmp_path)
    assert times_shown(world, "R1") == times_shown(world, "R2") == TIMES.tolist()
    assert world.notes == ()


def test_clocks_that_seem_to_differ_by_their_recordings_ends_are_told(tmp_path: Path) -> None:
    later(tmp_path, "R1", 0, 0)
    later(tmp_path, "R2", 1.0, 1.0)
    world = BagWorld(tmp_path)
    (note,) = world.notes
    assert "share 0.5 s, the longest (R1) has 1.5 s" in note
    assert "[robots.R2] of world.toml needs clock_offset_s = 1.000" in note
    (tmp_path / "world.toml").write_text("[robots.R2]\nclock_offset_s = 1.0\n")
    assert BagWorld(tmp_path).notes == ()


def test_bags_of_an_hour_apart_are_refused_with_what_would_help(tmp_path: Path) -> None:
    later(tmp_path, "R1", 0, 0)
    later(tmp_path, "R2", 3600, 3600)
    with pytest.raises(WorldError, match=r"share no time: R1 .*; R2 .*clock_offset_s = 3600\.000"):
        BagWorld(tmp_path)


def test_simulated_time_tells_nothing_of_clocks(tmp_path: Path) -> None:
    """A simulation at half speed, of which one robot was recorded longer."""
    for robot, count in (("R1", 16), ("R2", 30)):
        log = plain_log(np.arange(count) / 10)
        begin = log.rows[0][2]
        log.rows = [
            (topic, kind, begin + 2 * (at - begin), message)
            for topic, kind, at, message in log.rows
        ]
        log.write(tmp_path / robot)
    world = BagWorld(tmp_path)
    assert times_shown(world, "R1") == times_shown(world, "R2") == TIMES.tolist()
    assert [one.lag_s for one in world.timings] == [None, None]


def test_bags_that_were_played_again_tell_nothing_of_clocks(tmp_path: Path) -> None:
    later(tmp_path, "R1", 0, 3e6)
    later(tmp_path, "R2", 0, 5e6)
    assert BagWorld(tmp_path).frame_count == 16


def test_lost_scans_are_counted(tmp_path: Path) -> None:
    kept = [time for at, time in enumerate(TIMES) if at not in (4, 5, 11)]
    log = Log().scans(kept).drive(TIMES).tf(0, MOUNT, static=True)
    log.write(tmp_path / "R1")
    world = BagWorld(tmp_path)
    (one,) = world.timings
    assert (one.scans, one.lost, one.rate_hz) == (13, 3, pytest.approx(10))
    assert world.notes == ("R1 lacks 3 scans between its 13",)


@pytest.mark.stumble("a bag that grows while it is read", command="coadapt worlds check dir")
@pytest.mark.parametrize("storage", STORAGES)
def test_a_bag_that_grows_shows_what_was_there_and_then_more(tmp_path: Path, storage: str) -> None:
    log = Log().drive(TIMES).tf(0, MOUNT, static=True)
    for time in TIMES:
        log.scans([time], np.column_stack([np.full((2000, 1), time), np.ones((2000, 2))]))
    whole = log.write(tmp_path / "whole", storage)
    (source,) = whole.glob(f"*{STORAGES[storage]}")
    raw = source.read_bytes()
    bag = tmp_path / "data" / "R1"
    bag.mkdir(parents=True)
    growing = bag / source.name
    growing.write_bytes(raw[: int(len(raw) * 0.7)])
    early = BagWorld(tmp_path / "data")
    shown = times_shown(early, "R1")
    assert 1 < len(shown) < 16
    with growing.open("ab") as file:
        file.write(raw[int(len(raw) * 0.7) :])
    assert times_shown(early, "R1") == shown, "what was there when it was opened"
    assert any("cut off" in note for note in early.notes)
    shutil.copy(whole / "metadata.yaml", bag)
    late = BagWorld(tmp_path / "data")
    assert times_shown(late, "R1") == TIMES.tolist()
    assert late.notes == ()


def test_the_clock_of_a_robot_is_checked_like_any_setting(tmp_path: Path) -> None:
    plain_log(TIMES).write(tmp_path / "R1")
    (tmp_path / "world.toml").write_text("[robots.R1]\nclock_offset_s = 'late'\n")
    with pytest.raises(WorldError, match=r"clock_offset_s = 'late' in .* is not valid"):
        open_world("bag", data=tmp_path)
