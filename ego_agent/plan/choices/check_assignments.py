"""Validation of who sends what, and how often: what cannot be is made good, or left out."""

from __future__ import annotations

from collections.abc import Sequence

from ego_agent.plan.choices.mixes import Mixes
from ego_agent.plan.choices.scoring import Score, Scorer
from swarm.messages import Assignment


def carried(
    scorer: Scorer, asked: Sequence[str], wanted: Sequence[Assignment], repairs: list[str]
) -> Score:
    """The assignments of those who were `asked`, who are candidates, as far as robots and link
    carry them; each change is a sentence in `repairs`.

    One whose algorithm cannot be used, or who cannot send it at the rate, gets what is nearest at a
    lower rate, or is left out; where all do not fit the link, the dearest for what they add are
    asked less often and then left out.
    """
    mixes = Mixes(scorer)
    by_robot = {one.robot: one for one in wanted if isinstance(one, Assignment)}
    taken: dict[str, int] = {}
    for robot in asked:
        one = by_robot.get(robot)
        if one is None:
            repairs.append(f"dropped {robot}: nothing is assigned to it")
            continue
        found = _nearest(mixes, one)
        if found is None:
            repairs.append(f"dropped {robot}: it cannot send {one.algorithm}")
            continue
        option = mixes.options[found]
        if option.rate_hz != one.rate_hz:
            rates = f"{option.rate_hz:g}, not {one.rate_hz:g}"
            repairs.append(f"{robot} is asked {rates} times a second")
        taken[robot] = found
    return _fitting(mixes, taken, repairs)


def _nearest(mixes: Mixes, one: Assignment) -> int | None:
    """The option with the same algorithm and the highest rate that is no higher, or else the
    lowest; None where the robot can send none."""
    i = mixes.scorer.row_of[one.robot] - 1
    able = [
        o
        for o, option in enumerate(mixes.options)
        if option.algorithm == one.algorithm and mixes.able[i, o]
    ]
    lower = [o for o in able if mixes.options[o].rate_hz <= one.rate_hz]
    if lower:
        return max(lower, key=lambda o: mixes.options[o].rate_hz)
    return min(able, key=lambda o: mixes.options[o].rate_hz, default=None)


def _fitting(mixes: Mixes, taken: dict[str, int], repairs: list[str]) -> Score:
    """What the link and the ego carry of the options taken."""
    scorer = mixes.scorer
    while True:
        score = mixes.score([_assignment(mixes, robot, o) for robot, o in taken.items()])
        assert score is not None, "only options that robots have are taken"
        if not taken or mixes.carries(score):
            return score
        robot = max(taken, key=lambda name: (_bytes_s(mixes, name, taken[name]), name))
        option = mixes.options[taken[robot]]
        rarer = _rarer(mixes, robot, taken[robot])
        if rarer is None:
            del taken[robot]
            size_kb = scorer.size(robot, option.algorithm) / 1e3
            repairs.append(f"dropped {robot}: its {size_kb:.1f} kB do not fit beside the others'")
        else:
            taken[robot] = rarer
            hz = mixes.options[rarer].rate_hz
            repairs.append(f"{robot} is asked {hz:g} times a second, as not all fit the link")


def _rarer(mixes: Mixes, robot: str, o: int) -> int | None:
    """The option with the next lower rate."""
    option = mixes.options[o]
    i = mixes.scorer.row_of[robot] - 1
    lower = [
        p
        for p, other in enumerate(mixes.options)
        if other.algorithm == option.algorithm
        and other.rate_hz < option.rate_hz
        and mixes.able[i, p]
    ]
    return max(lower, key=lambda p: mixes.options[p].rate_hz, default=None)


def _bytes_s(mixes: Mixes, robot: str, o: int) -> float:
    return mixes.takes(robot, o) * mixes.scorer.pace.rate_hz


def _assignment(mixes: Mixes, robot: str, o: int) -> Assignment:
    return mixes.assignment(robot, o)
