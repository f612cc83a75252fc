"""Who drives and who stands where, over all frames, so that no two vehicles ever touch."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from swarm.errors import WorldError
from worlds.road.meshes import Floats
from worlds.road.streets import Crossing, Lane, Street
from worlds.road.vehicles import Vehicle, draw_vehicle, recording_car

RATE_HZ = 10.0
FRAMES = 100
VEHICLES = (10, 45)
"""How many vehicles a scene aims at, in OPV2V's evaluation range around its middle."""
REACH_M = (140.0, 40.0)
"""Half sizes of that range along and across the main road."""
APART_M = (10.0, 70.0)
"""Distance of a robot to the first one, in the middle frame."""
_CIRCLES = 4
_CLEAR_M = 0.05
_FLOWS = (0.3, 0.2, 0.5)
"""Shares of lanes that stand, creep and flow."""
_TRIES = 400


@dataclass(frozen=True, slots=True)
class Actor:
    """A vehicle and where it is in each frame."""

    identity: str
    vehicle: Vehicle
    states: Floats
    """(FRAMES, 6): x, y, z of the ground below its middle, then yaw, pitch, roll; see
    swarm.geometry.Pose."""


@dataclass(frozen=True, slots=True)
class _Track:
    """A line through the world, (N, 3), and the distance along it of each point."""

    points: Floats
    along: Floats

    def at(self, distance: Floats) -> tuple[Floats, Floats]:
        """Points (F, 3) and headings (F,) at these distances."""
        points = np.stack([np.interp(distance, self.along, c) for c in self.points.T], axis=1)
        step = np.gradient(self.points[:, :2], axis=0)
        heading = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
        return points, np.interp(distance, self.along, heading)


@dataclass(frozen=True, slots=True)
class _Wish:
    """A place that a vehicle may take, if it stays clear of the others."""

    track: _Track
    distance: float
    """Along the track, in the middle frame."""
    speed: float
    push: float = 0.0
    """Acceleration, m/s2; a vehicle that comes to a halt stays."""
    turn: float = 0.0
    """Parked askew by this angle."""


class _Crowd:
    """Vehicles that keep clear of each other: each is covered by circles."""

    def __init__(self, street: Street) -> None:
        self._street = street
        self._circles = np.zeros((FRAMES, 0, 2))
        self._radii = np.zeros(0)
        self.actors: list[Actor] = []

    def admit(self, identity: str, vehicle: Vehicle, wish: _Wish) -> bool:
        """Takes the vehicle in unless it would ever touch another."""
        states = _states(self._street, wish)
        length, width, _ = vehicle.size
        places = length * ((np.arange(_CIRCLES) + 0.5) / _CIRCLES - 0.5)
        way = np.stack([np.cos(states[:, 3]), np.sin(states[:, 3])], axis=1)
        circles = states[:, None, :2] + places[None, :, None] * way[:, None]
        radius = math.hypot(width / 2, length / _CIRCLES / 2)
        gaps = circles[:, :, None] - self._circles[:, None]
        touching = (gaps**2).sum(axis=-1) < (radius + self._radii + _CLEAR_M) ** 2
        if touching.any():
            return False
        self._circles = np.concatenate([self._circles, circles], axis=1)
        self._radii = np.concatenate([self._radii, np.full(_CIRCLES, radius)])
        self.actors.append(Actor(identity, vehicle, states))
        return True


def make_traffic(street: Street, robots: int, rng: np.random.Generator) -> list[Actor]:
    """The robots R1, R2, ... and then the other vehicles V1, V2, ...

    Raises WorldError when the robots find no room.
    """
    crowd = _Crowd(street)
    flow = {lane: _flow(rng) for lane in street.lanes}
    _place_robots(crowd, street, flow, robots, rng)
    wishes = [
        *_driving(street, flow, rng),
        *_turning(street, rng),
        *_crossing(street, rng),
        *_parked(street, rng),
    ]
    target = int(rng.integers(VEHICLES[0], VEHICLES[1] + 1))
    # When few are wanted, whole rows near the first robot are better than a thin scatter.
    spot = crowd.actors[0].states[FRAMES // 2, :2] + rng.normal(0.0, 10.0, 2)
    middle = [wish.track.at(np.array([wish.distance]))[0][0, :2] for wish in wishes]
    order = np.argsort([np.hypot(*(m - spot)) * rng.uniform(0.6, 1.4) for m in middle])
    for i in order:
        if len(crowd.actors) >= max(target, robots + 1):
            break
        identity = f"V{len(crowd.actors) - robots + 1}"
        crowd.admit(identity, draw_vehicle(rng), wishes[int(i)])
    return crowd.actors


def _flow(rng: np.random.Generator) -> float:
    """Speed of a lane, m/s: all of its vehicles drive alike."""
    return float(
        rng.choice([0.0, rng.uniform(1.0, 4.0), rng.uniform(4.0, 11.0)], p=[0.3, 0.2, 0.5])
    )


def _place_robots(
    crowd: _Crowd, street: Street, flow: dict[Lane, float], robots: int, rng: np.random.Generator
) -> None:
    car = recording_car()
    near, far = APART_M
    first = rng.uniform(-20.0, 20.0)
    for number in range(1, robots + 1):
        for _ in range(_TRIES):
            lane = street.lanes[int(rng.integers(len(street.lanes)))]
            # A large swarm spreads along the road.
            away = float(rng.uniform(near, max(far, 12.0 * robots / len(street.lanes))))
            u = first if number == 1 else first + away * float(rng.choice([-1.0, 1.0]))
            speed = flow[lane] or float(rng.choice([0.0, 2.0]))
            track = _lane_track(street, lane.across, lane.direction)
            wish = _Wish(track, _reach(street, track, u, lane.across), speed, rng.normal(0.0, 0.2))
            if crowd.admit(f"R{number}", car, wish):
                break
        else:
            raise WorldError(f"this road has no room for {robots} robots")


def _driving(street: Street, flow: dict[Lane, float], rng: np.random.Generator) -> Iterator[_Wish]:
    for lane in street.lanes:
        track = _lane_track(street, lane.across, lane.direction)
        dense = float(np.sqrt(rng.random()))
        u = -REACH_M[0] - rng.uniform(0.0, 20.0)
        while u < REACH_M[0]:
            distance = _reach(street, track, u, lane.across)
            yield _Wish(track, distance, flow[lane], float(rng.normal(0.0, 0.1)))
            u += 5.5 + (rng.uniform(0.5, 4.0) if rng.random() < dense else rng.uniform(6.0, 60.0))


def _crossing(street: Street, rng: np.random.Generator) -> Iterator[_Wish]:
    """Queues at the side roads' stop lines, and cross traffic."""
    for crossing in street.crossings:
        flows = rng.random() < 0.4 and len(crossing.sides) == 2
        for lane in crossing.lanes:
            track = _side_track(street, lane.across, lane.direction)
            for side in crossing.sides:
                # Vehicles that come stand at the line, those that leave are on their way.
                away = street.half_width + rng.uniform(3.5, 7.0)
                while away < 60.0 and rng.random() < 0.75:
                    distance = _reach(street, track, lane.across, side * away)
                    leaves = side == lane.direction
                    speed = rng.uniform(3.0, 8.0) if flows or leaves else 0.0
                    yield _Wish(track, distance, float(speed))
                    away += rng.uniform(6.0, 9.0) * (2.5 if speed else 1.0)


def _turning(street: Street, rng: np.random.Generator) -> Iterator[_Wish]:
    """Vehicles between the main road and a side road, slow or waiting."""
    for crossing in street.crossings:
        for side in crossing.sides:
            for _ in range(int(rng.integers(0, 4))):
                track = _turn_track(street, crossing, side, rng)
                spread = float(rng.uniform(0.2, 0.8)) * float(track.along[-1])
                yield _Wish(track, spread, float(rng.choice([0.0, rng.uniform(0.5, 3.0)])))


def _parked(street: Street, rng: np.random.Generator) -> Iterator[_Wish]:
    for side in street.parking:
        v = side * (street.half_width - 1.2)
        full = rng.uniform(0.2, 1.0)
        for start, end in street.gaps():
            for u in np.arange(max(start, -REACH_M[0]) + 6.0, min(end, REACH_M[0]) - 6.0, 5.9):
                if rng.random() < full:
                    at = street.place([u - 1.0, u + 1.0], v)
                    yield _still(at if side < 0 else at[::-1], rng)
    for block in street.blocks:
        if not block.parking:
            continue
        full = rng.uniform(0.2, 0.9)
        spots = np.arange(
            max(block.start, -REACH_M[0]) + 4.0, min(block.end, REACH_M[0]) - 4.0, 2.9
        )
        for u in spots:
            if rng.random() < full:
                away = block.pavement_m + 3.5
                at = street.land(block, u, np.array([away - 1.0, away + 1.0]))
                yield _still(at[:: int(rng.choice([-1, 1]))], rng)


def _still(line: Floats, rng: np.random.Generator) -> _Wish:
    jitter = float(rng.normal(0.0, 0.2))
    return _Wish(_track(line), 1.0 + jitter, 0.0, turn=float(rng.normal(0.0, 0.03)))


def _lane_track(street: Street, v: float, direction: int) -> _Track:
    u = np.arange(-230.0, 230.5, 1.0) * direction
    return _track(street.place(u, v))


def _side_track(street: Street, u: float, direction: int) -> _Track:
    v = np.arange(-125.0, 125.5, 1.0) * direction
    return _track(street.place(u, v))


def _turn_track(street: Street, crossing: Crossing, side: int, rng: np.random.Generator) -> _Track:
    """From the main road round the corner into the side road, or the other way."""
    lane = street.lanes[int(rng.integers(len(street.lanes)))]
    out = [other for other in crossing.lanes if other.direction == side]
    across = out[int(rng.integers(len(out)))].across
    # A quadratic Bezier curve between points on both lanes.
    begin, end = 9.0 + abs(across - crossing.u), street.half_width + 8.0
    corner = np.array([across, lane.across])
    start = corner - np.array([lane.direction * begin, 0.0])
    stop = np.array([across, side * end])
    share = np.linspace(0.0, 1.0, 41)[:, None]
    line = (1 - share) ** 2 * start + 2 * share * (1 - share) * corner + share**2 * stop
    points = street.place(line[:, 0], line[:, 1])
    return _track(points if rng.random() < 0.7 else points[::-1])


def _track(points: Floats) -> _Track:
    steps = np.hypot(*np.diff(points[:, :2], axis=0).T)
    return _Track(points, np.concatenate([[0.0], np.cumsum(steps)]))


def _reach(street: Street, track: _Track, u: float, v: float) -> float:
    """The distance along the track at which it passes the place (u, v)."""
    spot = street.place(u, v)
    return float(track.along[np.argmin(np.hypot(*(track.points - spot)[:, :2].T))])


def _states(street: Street, wish: _Wish) -> Floats:
    """(FRAMES, 6), see Actor."""
    time = (np.arange(FRAMES) - FRAMES / 2) / RATE_HZ
    speed = np.maximum(wish.speed + wish.push * time if wish.speed else 0.0 * time, 0.0)
    driven = np.cumsum(speed) / RATE_HZ
    distance = wish.distance + driven - driven[FRAMES // 2]
    points, heading = wish.track.at(np.clip(distance, 0.0, wish.track.along[-1]))
    yaw = heading + wish.turn
    ahead, left = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
    x, y = points[:, 0], points[:, 1]
    climb, lean = (
        street.height(x + dx, y + dy) - street.height(x - dx, y - dy) for dx, dy in (ahead, left)
    )
    pitch, roll = -np.arctan(climb / 2.0), np.arctan(lean / 2.0)
    return np.column_stack([points, yaw, pitch, roll])
