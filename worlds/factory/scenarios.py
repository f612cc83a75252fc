"""Who is on the floor and how they move, by scenario.

Lanes by their distance from a block: workers who stand at it 0.45 m, robots 1.4 m, forklifts
2.75 m, walking workers 3.85 m; the aisle's middle lies at 4.2 m. Nobody's lane crosses another's.
"""

from __future__ import annotations

import math

import numpy as np

from swarm.errors import WorldError
from worlds.factory.actors import FORKLIFT, ROBOT, WORKER, Actor, Shape
from worlds.factory.layout import AISLE_M, BLOCK_M, Block, Floor
from worlds.factory.paths import Laps, Loop, Path, Standing

SCENARIOS = ("floor", "redundant-cluster", "transient-occlusion", "bandwidth-drop")
PERIOD_S = 600.0
HALF = BLOCK_M / 2
STAND_M, ROBOT_M, FORKLIFT_M, WALK_M = 0.45, 1.4, 2.75, 3.85
CLUSTER = 4
"""Robots of `redundant-cluster` that drive in a convoy..."""
CLUSTER_GAP_M = 2.2
"""...this far apart."""
OCCLUSION_EVERY_S = 60.0
OCCLUSION_AT_S = 20.0
"""In `transient-occlusion`, the forklift is in front of the ego at this time and every minute
after it."""
FAST_BPS, SLOW_BPS, DROP_EVERY_S = 55e6, 0.75e6, 120.0
"""The paper's high rate, and what telemetry that uses 85 % of its low one (5 Mbit/s) leaves."""


def check_scenario(name: str) -> str:
    """The name, if there is such a scenario. Raises WorldError."""
    if name not in SCENARIOS:
        raise WorldError(f"scenario {name!r} is not known; allowed: {', '.join(SCENARIOS)}")
    return name


def link_rate_bps(scenario: str, time_s: float) -> float | None:
    """The link's capacity that the scenario asks for, bit/s, or None where it asks for none.

    `bandwidth-drop`: a minute of 55 Mbit/s, then a minute of 0.75 Mbit/s, and again.
    """
    steps = link_steps_bps(scenario)
    if steps is None:
        return None
    rates, interval_s = steps
    return float(rates[int(time_s // interval_s) % len(rates)])


def link_steps_bps(scenario: str) -> tuple[tuple[int, ...], float] | None:
    """The same as capacities that follow one another for ever, and the seconds that each lasts."""
    if scenario != "bandwidth-drop":
        return None
    return (round(FAST_BPS), round(SLOW_BPS)), DROP_EVERY_S / 2


def cast(scenario: str, floor: Floor, robots: int, rng: np.random.Generator) -> tuple[Actor, ...]:
    """All actors: robots R1 to Rn, forklifts F1..., workers W1..."""
    blocks = floor.blocks
    if scenario == "redundant-cluster":
        members = min(CLUSTER, robots)
        fleet = _convoy(blocks[0], members) + _fleet(blocks[1:], robots - members, rng)
        others = _traffic(blocks, rng)
    elif scenario == "transient-occlusion":
        fleet, others = _occlusion(blocks[0])
        fleet += _fleet(blocks[2:], robots - len(fleet), rng)
    else:
        fleet = _fleet(blocks, robots, rng)
        others = _traffic(blocks, rng)
    actors = [Actor(f"R{i + 1}", ROBOT, path) for i, path in enumerate(fleet)]
    for letter, shape in (("F", FORKLIFT), ("W", WORKER)):
        paths = [path for kind, path in others if kind is shape]
        actors += [Actor(f"{letter}{i + 1}", shape, path) for i, path in enumerate(paths)]
    return tuple(actors)


def _laps(block: Block, offset: float, laps: int, phase: float) -> Laps:
    return Laps(Loop(block.x, block.y, HALF, offset), laps, PERIOD_S, phase)


def _fleet(blocks: tuple[Block, ...], robots: int, rng: np.random.Generator) -> list[Path]:
    """Robots spread evenly over the blocks, those of one block evenly over its lane, at about
    1.0 to 1.4 m/s."""
    paths: list[Path] = []
    laps = rng.integers(10, 15, len(blocks))
    start = rng.random(len(blocks))
    for i in range(robots):
        lane, rank = i % len(blocks), i // len(blocks)
        sharing = (robots - lane - 1) // len(blocks) + 1
        phase = float(start[lane]) + rank / sharing
        paths.append(_laps(blocks[lane], ROBOT_M, int(laps[lane]), phase))
    return paths


def _convoy(block: Block, robots: int) -> list[Path]:
    """Robots one behind the other."""
    gap = CLUSTER_GAP_M / Loop(block.x, block.y, HALF, ROBOT_M).length
    return [_laps(block, ROBOT_M, 12, -i * gap) for i in range(robots)]


def _traffic(blocks: tuple[Block, ...], rng: np.random.Generator) -> list[tuple[Shape, Path]]:
    """Every other block has a forklift around it (1.5 to 2 m/s), the others a worker (0.9 to
    1.2 m/s); workers stand at the machines and conveyors, and a forklift waits at each conveyor."""
    traffic: list[tuple[Shape, Path]] = []
    for i, block in enumerate(blocks):
        phase = float(rng.random())
        if i % 2 == 0:
            traffic.append((FORKLIFT, _laps(block, FORKLIFT_M, int(rng.integers(14, 19)), phase)))
        else:
            traffic.append((WORKER, _laps(block, WALK_M, int(rng.integers(7, 11)), phase)))
        if block.kind != "shelving":
            along = float(rng.uniform(-HALF, HALF))
            traffic.append((WORKER, Standing(block.x + along, block.y + HALF + STAND_M, 0.0)))
        if block.kind == "conveyor":
            traffic.append((FORKLIFT, Standing(block.x + 2.5, block.y - 4.2, math.pi)))
    return traffic


def _occlusion(block: Block) -> tuple[list[Path], list[tuple[Shape, Path]]]:
    """R1 and R2 wait on the two sides of an aisle, a worker stands between them, and a forklift
    passes slowly between R1 and the worker, once a minute."""
    edge = block.x + HALF
    ego = Standing(edge + ROBOT_M, block.y, -math.pi / 2)
    witness = Standing(edge + AISLE_M - ROBOT_M, block.y + 4.0, math.pi / 2)
    worker = Standing(edge + AISLE_M - 3.2, block.y, math.pi)
    loop = Loop(block.x, block.y, HALF, FORKLIFT_M)
    there = (loop.length / 2 + HALF) / loop.length
    slow_at = OCCLUSION_AT_S / OCCLUSION_EVERY_S
    laps = round(PERIOD_S / OCCLUSION_EVERY_S)
    forklift = Laps(loop, laps, PERIOD_S, there - slow_at, sway=0.5, slow_at=slow_at)
    return [ego, witness], [(FORKLIFT, forklift), (WORKER, worker)]
