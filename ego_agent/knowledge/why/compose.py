"""Why a decision was made, in sentences that say what its journal line says and nothing else.

Each sentence states values of the line, or compares two lines; numbers are rounded, never
estimated. A model's words, which journals hold too, are no facts and stand in none.
"""

from __future__ import annotations

from collections.abc import Iterator

import msgspec

from ego_agent.knowledge.journal import CycleRecord, Decided
from ego_agent.knowledge.pace import often
from ego_agent.knowledge.weighed import Weighed, Weighing
from ego_agent.knowledge.why.find import Found

MOST_QUOTED = 4
"""Of repairs and of robots that could not take part."""
_FORMS = {"early": "points", "intermediate": "feature maps", "late": "boxes"}
"""What robots send for an algorithm, in words (docs/glossary.md)."""


class Explanation(msgspec.Struct, frozen=True, kw_only=True):
    """Why, in groups of sentences; a group without anything to tell is empty."""

    ego: str
    cycle: int
    decision: tuple[str, ...]
    """What was decided, and by whom."""
    robots: tuple[str, ...]
    """What each one adds and costs, and why the others are out."""
    changed: tuple[str, ...]
    """Since the decision before."""
    limits: tuple[str, ...]
    """Which bound it."""
    otherwise: tuple[str, ...]
    """The best other choice, and why it was not taken."""
    lacks: tuple[str, ...]
    """What the journal does not say."""

    def text(self) -> str:
        """All of it, a sentence a line."""
        groups = (self.decision, self.robots, self.changed, self.limits, self.otherwise, self.lacks)
        return "\n".join(sentence for group in groups for sentence in group)


def explain(found: Found) -> Explanation:
    """Why the decision of the found line was made."""
    line = found.line
    weighed = line.weighed
    return Explanation(
        ego=line.ego,
        cycle=line.cycle,
        decision=tuple(_decision(line)),
        robots=tuple(_robots(line)),
        changed=tuple(_changed(found)),
        limits=tuple(_limits(line)),
        otherwise=tuple(_otherwise(line, weighed)) if weighed else (),
        lacks=tuple(_lacks(found)),
    )


def _decision(line: CycleRecord) -> Iterator[str]:
    decision = line.decision
    cost = f"{_kb(decision.cost_bytes)} kB a frame"
    yield (
        f"Cycle {line.cycle}: {_choice(line)}; quality {decision.quality:.3f} is expected, for "
        f"{cost}."
    )
    yield from _sends(decision)
    if decision.source == "fallback" and decision.policy != "coverage":
        yield f"Policy {decision.policy} was asked; coverage decided in its place."
    elif decision.model:
        yield f"Policy {decision.policy} decided, on the advice of {decision.model}."
    else:
        yield f"Policy {decision.policy} decided."
    for repair in decision.repairs[:MOST_QUOTED]:
        yield f'On the way: "{repair}".'
    if decision.blind:
        yield f'Blind: "{decision.blind}".'


def _choice(line: CycleRecord) -> str:
    decision = line.decision
    helpers = [robot for robot in decision.participants if robot != line.ego]
    if not helpers:
        return f"{line.ego} alone"
    rate = f" at {decision.rate_hz:g} Hz" if decision.rate_hz is not None else ""
    return f"{line.ego} with {_names(helpers)}, {decision.algorithm} fusion{rate}"


def _sends(decision: Decided) -> Iterator[str]:
    """Who sends what, and how often, unless all send the decision's form in every frame."""
    alike: dict[tuple[str, float, float, bool], list[str]] = {}
    for one in decision.assignments:
        what = (one.algorithm, one.rate_hz, one.places_hz, one.objects_only)
        alike.setdefault(what, []).append(one.robot)
    if alike.keys() <= {(decision.algorithm, decision.rate_hz, 0.0, False)}:
        return
    parts: list[str] = []
    for (algorithm, rate_hz, places_hz, objects_only), robots in alike.items():
        verb = "" if parts else "send " if len(robots) > 1 else "sends "
        form = _FORMS.get(algorithm, f"{algorithm} contributions")
        form += " of what may be an object" if objects_only else ""
        between = f" ({often(places_hz)} those of what is remembered)" if places_hz else ""
        parts.append(f"{_names(robots)} {verb}{form} {often(rate_hz)}{between}")
    yield f"{', '.join(parts)}."


def _robots(line: CycleRecord) -> Iterator[str]:
    decision, weighed = line.decision, line.weighed
    if weighed is not None:
        for robot, one in weighed.robots.items():
            yield _robot(line, robot, one, weighed)
        if weighed.left_out:
            yield f"{weighed.left_out} more that could take part would add less."
    for robot, chance in decision.arrival.items():
        if chance < 1.0:
            yield f"{robot} is in time with a chance of {chance:.2f}."
    for robot, why in decision.silent.items():
        yield f'Of {robot} nothing arrives: "{why}".'
    shown = list(line.inputs.excluded.items())[:MOST_QUOTED]
    for robot, why in shown:
        yield f'{robot} could not take part: "{why}".'
    if more := len(line.inputs.excluded) - len(shown):
        yield f"{more} more could not take part."


def _robot(line: CycleRecord, robot: str, one: Weighing, weighed: Weighed) -> str:
    decision = line.decision
    taken = robot in decision.participants
    place = "in" if taken else "out"
    known = line.inputs.robots.get(robot)
    size = known.sizes.get(decision.algorithm) if known else None
    if one.why == "size":
        return f"{robot} is {place}: the size of its {decision.algorithm} observation is not known."
    if one.why == "link":
        return f"{robot} is {place}: its own link does not carry its {decision.algorithm} frames."
    if one.why == "fit":
        what = f"its {_kb(size)} kB do" if size is not None else "it does"
        return (
            f"{robot} is {place}: {what} not fit beside {_kb(decision.cost_bytes)} of "
            f"{_kb(weighed.budget_bytes)} kB."
        )
    worth = f"{one.adds:.4f} and {'costs' if taken else 'cost'} {one.costs:.4f}"
    text = f"{robot} is {place}: it {'adds' if taken else 'would add'} {worth}"
    ends = {
        "pays": ".",
        "costs": ".",
        "q_min": ", which Q_min takes.",
        "kept": ", and no change was made for that.",
    }
    return text + ends[one.why]


def _changed(found: Found) -> Iterator[str]:
    line, before = found.line, found.before
    if found.since != line.cycle:
        yield f"The same has been decided since cycle {found.since}."
    if before is None:
        return
    yield f"Until cycle {before.cycle}: {_choice(before)}."
    now, then = line.decision, before.decision
    came = [robot for robot in now.participants if robot not in then.participants]
    went = [robot for robot in then.participants if robot not in now.participants]
    if came:
        yield f"Came: {_names(came)}."
    if went:
        yield f"Went: {_names(went)}."
    for robot in went:
        if robot in line.inputs.excluded:
            yield f"{robot} can take part no more."
        elif robot not in line.inputs.robots:
            yield f"{robot} is not known any more."
    for robot in came:
        if robot in before.inputs.excluded or robot not in before.inputs.robots:
            yield f"{robot} could not take part then."
    yield from _numbers(line, before)
    ours, theirs = ({wish.number for wish in one.intents} for one in (line, before))
    for number in sorted(ours ^ theirs):
        yield f"Wish {number} {'came' if number in ours else 'ended'}."
    if now.policy != then.policy:
        yield f"The policy was {then.policy} then."


def _numbers(line: CycleRecord, before: CycleRecord) -> Iterator[str]:
    now, then = line.decision, before.decision
    link, was = line.inputs.capacity_bps, before.inputs.capacity_bps
    if link != was:
        yield f"The link carries {_mbit(link)} Mbit/s, {_mbit(was)} then."
    if round(now.quality, 3) != round(then.quality, 3):
        yield f"The quality is {now.quality:.3f}, {then.quality:.3f} then."
    if line.weighed and before.weighed and line.weighed.q_min != before.weighed.q_min:
        yield f"Q_min is {line.weighed.q_min:g}, {before.weighed.q_min:g} then."


def _limits(line: CycleRecord) -> Iterator[str]:
    decision, weighed = line.decision, line.weighed
    for wish in line.intents:
        by = f" of {wish.operator}" if wish.operator else ""
        yield f'Wish {wish.number}{by} is in force: "{wish.says}".'
        for bound in wish.bound:
            yield f'Wish {wish.number} bound it: "{bound}".'
    if weighed is None:
        return
    verdicts = {one.why for one in weighed.robots.values()}
    if "fit" in verdicts:
        yield f"The link bounds it: a frame may cost {_kb(weighed.budget_bytes)} kB."
    if "link" in verdicts:
        yield "Robots' own links bound it."
    if decision.quality < weighed.q_min:
        yield f"Q_min is not reached: {decision.quality:.3f} of {weighed.q_min:g}."
    elif "q_min" in verdicts:
        yield f"Q_min bounds it: {weighed.q_min:g} must be reached."


def _otherwise(line: CycleRecord, weighed: Weighed) -> Iterator[str]:
    other, decision = weighed.other, line.decision
    if other is None:
        yield "Nothing else could be chosen."
        return
    helpers = [robot for robot in other.participants if robot != line.ego]
    what = "nobody"
    if helpers:
        what = f"{_names(helpers)} with {other.algorithm} fusion at {other.rate_hz:g} Hz"
    yield (
        f"The best other choice, {what}, would give quality "
        f"{other.quality:.3f} for {_kb(other.cost_bytes)} kB a frame: less its cost "
        f"{other.value:.4f}, against {weighed.value:.4f}."
    )
    yield _why_not(decision, weighed)


def _why_not(decision: Decided, weighed: Weighed) -> str:
    """Why the best other choice was not taken, by what decides among choices (docs/decision.md)."""
    other = weighed.other
    assert other is not None
    good, other_good = decision.quality >= weighed.q_min, other.quality >= weighed.q_min
    if good and not other_good:
        return f"It would miss Q_min, {weighed.q_min:g}."
    if other_good and not good:
        return f"It would reach Q_min, but {_who(decision)} chose otherwise."
    ours, theirs = (weighed.value, other.value) if good else (decision.quality, other.quality)
    if theirs <= ours:
        return "It is no better."
    if theirs - ours <= weighed.switch_gain:
        return f"It is better by no more than {weighed.switch_gain:g}, and no change pays for that."
    if decision.held_s is not None and 0.0 < decision.held_s < weighed.dwell_s:
        return (
            f"The decision has stood for {decision.held_s:.1f} s, and stays {weighed.dwell_s:g} s "
            "unless it must go."
        )
    if _reserve_is_touched(decision, weighed):
        percent = 100 * weighed.upgrade_reserve
        return f"It costs more, and would leave less than {percent:g} % of the link free."
    return f"It is better, but {_who(decision)} chose otherwise."


def _reserve_is_touched(decision: Decided, weighed: Weighed) -> bool:
    other = weighed.other
    assert other is not None
    if decision.rate_hz is None:
        return False
    costlier = other.cost_bytes * other.rate_hz > decision.cost_bytes * decision.rate_hz
    return costlier and other.cost_bytes > other.budget_bytes * (1.0 - weighed.upgrade_reserve)


def _who(decision: Decided) -> str:
    return "coverage" if decision.source == "fallback" else f"policy {decision.policy}"


def _lacks(found: Found) -> Iterator[str]:
    if found.line.weighed is None:
        yield (
            "This line does not say what robots add and cost, nor what else could be chosen: it "
            "is of an older program, or the scene could not be told."
        )
    if found.before is None:
        yield "The journal holds no other decision before this one."


def _names(robots: list[str]) -> str:
    *first, last = robots
    return f"{', '.join(first)} and {last}" if first else last


def _kb(size: float) -> str:
    return f"{size / 1e3:.1f}"


def _mbit(rate_bps: float) -> str:
    return f"{rate_bps / 1e6:.2f}"
