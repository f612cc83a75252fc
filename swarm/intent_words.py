"""Intents and their effects in plain words, which code composes."""

from __future__ import annotations

from datetime import datetime

from swarm.messages.intent import Intent, Weight
from swarm.messages.obeyed import MAX_SENTENCE, Effect

_MORE: dict[Weight, str] = {"high": "more", "low": "less"}


def in_words(intent: Intent) -> str:
    """What an intent wishes, in one sentence; "nothing" for an empty one.

    >>> in_words(Intent(exclude=("R3",), link_share=0.5, until="2027-01-15T18:00:00+01:00"))
    'leave R3 out; use at most 50 % of the link; until 2027-01-15 18:00 +01:00'
    """
    said = []
    if intent.exclude:
        said.append(f"leave {_listed(intent.exclude)} out")
    if intent.only is not None:
        said.append(f"ask nobody but {_listed(intent.only)}" if intent.only else "ask nobody")
    if intent.prefer:
        said.append(f"rather ask {_listed(intent.prefer)}")
    said += [f"{spot.place} counts {_MORE[spot.weight]}" for spot in intent.focus]
    said += [f"{label} counts {_MORE[weight]}" for label, weight in intent.classes.items()]
    if intent.q_min is not None:
        said.append(f"quality at least {intent.q_min:g} where that can be reached")
    if intent.link_share is not None:
        said.append(f"use at most {100 * intent.link_share:g} % of the link")
    if intent.save is not None:
        said.append(f"save {intent.save}")
    if intent.policy is not None:
        said.append(f"decide by {intent.policy}")
    if not said:
        return "nothing"
    if (start := intent.starts()) is not None:
        said.append(f"from {_at(start)}")
    if (until := intent.ends()) is not None:
        said.append(f"until {_at(until)}")
    return sentence("; ".join(said))


def sentence(text: str) -> str:
    """A sentence as long as messages carry one; what is cut off is said to be."""
    end = " ... and more"
    return text if len(text) <= MAX_SENTENCE else text[: MAX_SENTENCE - len(end)] + end


def _at(time: datetime) -> str:
    seconds = ":%S" if time.second else ""
    zone = time.strftime("%z")
    return time.strftime(f"%Y-%m-%d %H:%M{seconds} ") + f"{zone[:3]}:{zone[3:5]}"


def _listed(names: tuple[str, ...]) -> str:
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last


def effect_in_words(effect: Effect) -> list[str]:
    """What a shadow replay found, one sentence each."""
    before, after = effect.before, effect.after
    if before is None or after is None:
        return ["not known: the ego has decided nothing in the last minute"]
    said = [
        f"over the last {effect.span_s:.0f} s ({effect.decisions} decisions by {effect.policy}): "
        f"{before.participants:.1f} -> {after.participants:.1f} participants, "
        f"{before.bytes_s / 1e3:.1f} -> {after.bytes_s / 1e3:.1f} kB/s, "
        f"Q {before.quality:.2f} -> {after.quality:.2f}"
    ]
    said += [
        f"{place}: {100 * before.seen[place]:.0f} -> {100 * share:.0f} % of what all see there"
        for place, share in after.seen.items()
        if place in before.seen
    ]
    robots = {*before.robots, *after.robots}
    changed = {
        robot: (before.robots.get(robot, 0.0), after.robots.get(robot, 0.0)) for robot in robots
    }
    said += [
        f"{robot} takes part in {100 * was:.0f} -> {100 * now:.0f} % of them"
        for robot, (was, now) in sorted(changed.items())
        if was != now
    ]
    if effect.nobody:
        said.append("it leaves NOBODY TO ASK: the ego goes on alone")
    return said
