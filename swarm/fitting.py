"""Whether two processes fit together: the marks of their worlds, their software, their clocks.

A mark is the kind of a world and what else has to be the same for two processes to see the same
things at the same time: "factory detector=factory epoch=0 robots=6 scenario=floor seed=1".
"""

from __future__ import annotations

from collections.abc import Mapping

CLOCK_OFF_S = 0.5
"""Two clocks that are set from one source are far closer."""
KIND = "world"
_EPOCH = "epoch"


def write_mark(kind: str, facts: Mapping[str, object]) -> str:
    """The mark of a world.

    >>> write_mark("factory", {"seed": 1, "epoch": 5})
    'factory epoch=5 seed=1'
    """
    return " ".join([kind, *(f"{name}={value}" for name, value in sorted(facts.items()))])


def read_mark(mark: str) -> dict[str, str]:
    """The facts of a mark, and its kind as `world`; what has another form is left out.

    >>> read_mark("factory epoch=5 seed=1")
    {'world': 'factory', 'epoch': '5', 'seed': '1'}
    """
    kind, *facts = mark.split(" ")
    return {KIND: kind} | {
        name: value for name, equals, value in (fact.partition("=") for fact in facts) if equals
    }


def other_world(own: str, other: str) -> str:
    """In what a robot's world is another one than the ego's, as the rest of a sentence; empty where
    it is the same one, or where one of the two does not say.

    >>> other_world("factory epoch=5 seed=1", "factory epoch=5 seed=2")
    "it lives in another world: seed 2 (the ego's: 1)"
    """
    if not own or not other or own == other:
        return ""
    ours, theirs = read_mark(own), read_mark(other)
    if ours[KIND] != theirs[KIND]:
        return f"it lives in another world: {theirs[KIND]}, the ego in {ours[KIND]}"
    # A fact that only one of the two programs tells is one of a newer program.
    differing = [name for name in ours if name in theirs and ours[name] != theirs[name]]
    words = [
        f"{name} {theirs[name]} (the ego's: {ours[name]})" for name in differing if name != _EPOCH
    ]
    if _EPOCH in differing:
        words.append(_epochs(ours[_EPOCH], theirs[_EPOCH]))
    return f"it lives in another world: {'; '.join(words)}" if words else ""


def _epochs(own: str, other: str) -> str:
    try:
        ahead_s = (int(own) - int(other)) * 1e-9
    except ValueError:
        return f"epoch {other} (the ego's: {own})"
    return f"its time runs {abs(ahead_s):.1f} s {'ahead of' if ahead_s > 0 else 'behind'} the ego's"


def remark(offset_s: float, own_software: str, other_software: str) -> str:
    """What is odd about a robot that fits all the same; empty where nothing is.

    `offset_s`: how far the robot's time of day is ahead of the ego's.
    """
    words = []
    if abs(offset_s) >= CLOCK_OFF_S:
        way = "ahead of" if offset_s > 0 else "behind"
        words.append(f"its clock is {abs(offset_s):.1f} s {way} the ego's (frames still fit)")
    if own_software and other_software and own_software != other_software:
        words.append(f"it runs version {other_software}, the ego {own_software}")
    return "; ".join(words)
