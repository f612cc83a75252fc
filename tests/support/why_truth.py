"""Whether sentences about a decision say what its journal says: a reader of its own.

It knows the journal as JSON and each form that a sentence may have; it shares nothing with the
code that writes sentences. A sentence of no known form counts as a lie.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

Line = dict[str, Any]
NAME = r"[A-Za-z0-9_-]+"
NAMES = rf"{NAME}(?:, {NAME})*(?: and {NAME})?"
NUMBER = r"-?\d+(?:\.\d+)?"
CHOICE = (
    rf"(?:(?P<{{0}}alone>{NAME}) alone|(?P<{{0}}ego>{NAME}) with (?P<{{0}}helpers>{NAMES}), "
    rf"(?P<{{0}}algorithm>{NAME}) fusion(?: at (?P<{{0}}rate>[\d.e+-]+) Hz)?)"
)


def untrue(sentences: list[str], line: Line, before: Line | None, since: int) -> list[str]:
    """Those of the sentences that the lines do not bear out. `since`: the first cycle with the
    line's choice."""
    return [text for text in sentences if not _true(text, line, before, since)]


def _true(text: str, line: Line, before: Line | None, since: int) -> bool:
    for form, holds in FORMS:
        match = re.fullmatch(form, text, re.DOTALL)
        if match:
            return holds(match.groupdict(), line, before, since)
    return False


def _names(text: str | None) -> list[str]:
    return re.split(r", | and ", text) if text else []


def _is(text: str, value: float | None, scale: float = 1.0) -> bool:
    """Whether a printed number is a value, rounded to as many digits as are printed."""
    if value is None:
        return False
    digits = len(text.partition(".")[2])
    return abs(float(text) - value / scale) <= 0.5 * 10.0**-digits * (1 + 1e-9) + 1e-9


def _near(text: str, value: float) -> bool:
    """Of a number printed with up to six digits."""
    return abs(float(text) - value) <= 1e-5 * max(1.0, abs(value))


def _chosen(found: dict[str, str], prefix: str, line: Line) -> bool:
    decision = line["decision"]
    helpers = [robot for robot in decision["participants"] if robot != line["ego"]]
    if found[f"{prefix}alone"]:
        return found[f"{prefix}alone"] == line["ego"] and not helpers
    rate = found[f"{prefix}rate"]
    return (
        found[f"{prefix}ego"] == line["ego"]
        and _names(found[f"{prefix}helpers"]) == helpers
        and bool(helpers)
        and found[f"{prefix}algorithm"] == decision["algorithm"]
        and (decision["rate_hz"] is None if rate is None else _near(rate, decision["rate_hz"]))
    )


def _decided(f: dict[str, str], line: Line, before: Line | None, since: int) -> bool:
    decision = line["decision"]
    return (
        int(f["cycle"]) == line["cycle"]
        and _chosen(f, "c", line)
        and _is(f["quality"], decision["quality"])
        and _is(f["kb"], decision["cost_bytes"], 1e3)
    )


def _worth(f: dict[str, str], line: Line, before: Line | None, since: int) -> bool:
    decision, weighed = line["decision"], line["weighed"]
    one = weighed["robots"].get(f["robot"])
    if one is None or (f["place"] == "in") != (f["robot"] in decision["participants"]):
        return False
    if (f["verb"] == "adds") != (f["place"] == "in"):
        return False
    if not (_is(f["adds"], one["adds"]) and _is(f["costs"], one["costs"])):
        return False
    end = f["end"]
    if end == ", which Q_min takes":
        return bool(one["why"] == "q_min")
    if end:
        return bool(one["why"] == "kept")
    return one["why"] == ("pays" if f["place"] == "in" else "costs")


def _unfit(f: dict[str, str], line: Line, before: Line | None, since: int) -> bool:
    decision, weighed = line["decision"], line["weighed"]
    one, robot = weighed["robots"].get(f["robot"]), line["inputs"]["robots"].get(f["robot"])
    return (
        one is not None
        and one["why"] == "fit"
        and f["robot"] not in decision["participants"]
        and (f["size"] is None or _is(f["size"], robot["sizes"][decision["algorithm"]], 1e3))
        and _is(f["taken"], decision["cost_bytes"], 1e3)
        and _is(f["budget"], weighed["budget_bytes"], 1e3)
    )


def _verdict(f: dict[str, str], line: Line, why: str) -> bool:
    one = line["weighed"]["robots"].get(f["robot"])
    inside = f["robot"] in line["decision"]["participants"]
    return one is not None and one["why"] == why and (f["place"] == "in") == inside


def _other(f: dict[str, str], line: Line, before: Line | None, since: int) -> bool:
    other, weighed = line["weighed"]["other"], line["weighed"]
    if other is None:
        return False
    helpers = [robot for robot in other["participants"] if robot != line["ego"]]
    who = (
        not helpers
        if f["nobody"]
        else _names(f["helpers"]) == helpers
        and f["algorithm"] == other["algorithm"]
        and _near(f["rate"], other["rate_hz"])
    )
    return (
        who
        and _is(f["quality"], other["quality"])
        and _is(f["kb"], other["cost_bytes"], 1e3)
        and _is(f["value"], other["value"])
        and _is(f["against"], weighed["value"])
    )


def _gain(line: Line) -> float | None:
    """How much better the other choice is, by what counts; None where only one reaches Q_min."""
    decision, weighed = line["decision"], line["weighed"]
    other = weighed["other"]
    good, other_good = (q["quality"] >= weighed["q_min"] for q in (decision, other))
    if good != other_good:
        return None
    if good:
        return float(other["value"] - weighed["value"])
    return float(other["quality"] - decision["quality"])


def _small(f: dict[str, str], line: Line, before: Line | None, since: int) -> bool:
    gain, least = _gain(line), line["weighed"]["switch_gain"]
    return gain is not None and 0 < gain <= least and _near(f["gain"], least)


def _stays(f: dict[str, str], line: Line, before: Line | None, since: int) -> bool:
    gain, held_s, dwell_s = _gain(line), line["decision"]["held_s"], line["weighed"]["dwell_s"]
    fits = _is(f["held"], held_s) and _near(f["dwell"], dwell_s)
    return gain is not None and gain > 0 and fits and held_s < dwell_s


def _reserve(f: dict[str, str], line: Line, before: Line | None, since: int) -> bool:
    decision, weighed = line["decision"], line["weighed"]
    other, gain = weighed["other"], _gain(line)
    free = 1 - other["cost_bytes"] / other["budget_bytes"]
    more = other["cost_bytes"] * other["rate_hz"] > decision["cost_bytes"] * decision["rate_hz"]
    reserve = weighed["upgrade_reserve"]
    return bool(gain and gain > 0 and more and free < reserve and _near(f["p"], 100 * reserve))


def _who(f: dict[str, str], line: Line) -> bool:
    decision = line["decision"]
    if f["who"] == "coverage":
        return bool(decision["source"] == "fallback")
    return bool(decision["source"] != "fallback" and f["who"] == f"policy {decision['policy']}")


def _better(f: dict[str, str], line: Line, before: Line | None, since: int) -> bool:
    gain = _gain(line)
    return gain is not None and gain > line["weighed"]["switch_gain"] and _who(f, line)


def _reach(line: Line, which: str) -> bool:
    one = line["decision"] if which == "ours" else line["weighed"]["other"]
    return bool(one["quality"] >= line["weighed"]["q_min"])


def _members(line: Line) -> set[str]:
    return set(line["decision"]["participants"])


def _came(f: dict[str, str], line: Line, before: Line | None, since: int) -> bool:
    return before is not None and set(_names(f["names"])) == _members(line) - _members(before)


def _went(f: dict[str, str], line: Line, before: Line | None, since: int) -> bool:
    return before is not None and set(_names(f["names"])) == _members(before) - _members(line)


def _gone(f: dict[str, str], line: Line, before: Line | None, since: int) -> bool:
    went = before is not None and f["robot"] in _members(before) - _members(line)
    if f["how"] == "can take part no more":
        return went and f["robot"] in line["inputs"]["excluded"]
    return went and f["robot"] not in line["inputs"]["robots"]


def _could_not(f: dict[str, str], line: Line, before: Line | None, since: int) -> bool:
    if before is None or f["robot"] not in _members(line) - _members(before):
        return False
    inputs = before["inputs"]
    return f["robot"] in inputs["excluded"] or f["robot"] not in inputs["robots"]


def _verdicts(line: Line) -> set[str]:
    return {one["why"] for one in line["weighed"]["robots"].values()}


def _excluded_more(f: dict[str, str], line: Line, before: Line | None, since: int) -> bool:
    return len(line["inputs"]["excluded"]) == 4 + int(f["n"]) and int(f["n"]) > 0


def _wish(f: dict[str, str], line: Line, before: Line | None, since: int) -> bool:
    return any(
        (str(one["number"]), one["operator"], one["says"])
        == (f["n"], f["operator"] or "", f["said"])
        for one in line["intents"]
    )


def _wishes(line: Line | None) -> set[str]:
    return {str(one["number"]) for one in line["intents"]} if line else set()


Holds = Callable[[dict[str, str], Line, Line | None, int], bool]
FORMS: list[tuple[str, Holds]] = [
    (
        rf"Cycle (?P<cycle>\d+): {CHOICE.format('c')}; quality (?P<quality>{NUMBER}) is expected, "
        rf"for (?P<kb>{NUMBER}) kB a frame\.",
        _decided,
    ),
    (
        rf"Policy (?P<policy>{NAME}) decided\.",
        lambda f, n, b, s: (
            f["policy"] == n["decision"]["policy"]
            and (n["decision"]["source"] != "fallback" or f["policy"] == "coverage")
        ),
    ),
    (
        rf"Policy (?P<policy>{NAME}) was asked; coverage decided in its place\.",
        lambda f, n, b, s: (
            f["policy"] == n["decision"]["policy"] and n["decision"]["source"] == "fallback"
        ),
    ),
    (
        rf"Policy (?P<policy>{NAME}) decided, on the advice of (?P<model>.+)\.",
        lambda f, n, b, s: (
            f["policy"] == n["decision"]["policy"] and f["model"] == n["decision"]["model"]
        ),
    ),
    (r'On the way: "(?P<said>.*)"\.', lambda f, n, b, s: f["said"] in n["decision"]["repairs"]),
    (r'Blind: "(?P<said>.+)"\.', lambda f, n, b, s: f["said"] == n["decision"]["blind"]),
    (
        rf"(?P<robot>{NAME}) is (?P<place>in|out): it (?P<verb>adds|would add) "
        rf"(?P<adds>{NUMBER}) and costs? (?P<costs>{NUMBER})"
        r"(?P<end>|, which Q_min takes|, and no change was made for that)\.",
        _worth,
    ),
    (
        rf"(?P<robot>{NAME}) is out: (?:its (?P<size>{NUMBER}) kB do|it does) not fit beside "
        rf"(?P<taken>{NUMBER}) of (?P<budget>{NUMBER}) kB\.",
        _unfit,
    ),
    (
        rf"(?P<robot>{NAME}) is (?P<place>in|out): the size of its (?P<algorithm>{NAME}) "
        r"observation is not known\.",
        lambda f, n, b, s: _verdict(f, n, "size") and f["algorithm"] == n["decision"]["algorithm"],
    ),
    (
        rf"(?P<robot>{NAME}) is (?P<place>in|out): its own link does not carry its "
        rf"(?P<algorithm>{NAME}) frames\.",
        lambda f, n, b, s: _verdict(f, n, "link") and f["algorithm"] == n["decision"]["algorithm"],
    ),
    (
        r"(?P<n>\d+) more that could take part would add less\.",
        lambda f, n, b, s: 0 < int(f["n"]) == n["weighed"]["left_out"],
    ),
    (
        rf"(?P<robot>{NAME}) is in time with a chance of (?P<p>{NUMBER})\.",
        lambda f, n, b, s: _is(f["p"], n["decision"]["arrival"].get(f["robot"])),
    ),
    (
        rf'Of (?P<robot>{NAME}) nothing arrives: "(?P<said>.*)"\.',
        lambda f, n, b, s: n["decision"]["silent"].get(f["robot"]) == f["said"],
    ),
    (
        rf'(?P<robot>{NAME}) could not take part: "(?P<said>.*)"\.',
        lambda f, n, b, s: n["inputs"]["excluded"].get(f["robot"]) == f["said"],
    ),
    (r"(?P<n>\d+) more could not take part\.", _excluded_more),
    (
        r"The same has been decided since cycle (?P<n>\d+)\.",
        lambda f, n, b, s: int(f["n"]) == s != n["cycle"],
    ),
    (
        rf"Until cycle (?P<n>\d+): {CHOICE.format('b')}\.",
        lambda f, n, b, s: b is not None and int(f["n"]) == b["cycle"] and _chosen(f, "b", b),
    ),
    (rf"Came: (?P<names>{NAMES})\.", _came),
    (rf"Went: (?P<names>{NAMES})\.", _went),
    (rf"(?P<robot>{NAME}) (?P<how>can take part no more|is not known any more)\.", _gone),
    (rf"(?P<robot>{NAME}) could not take part then\.", _could_not),
    (
        rf"The link carries (?P<now>{NUMBER}) Mbit/s, (?P<then>{NUMBER}) then\.",
        lambda f, n, b, s: (
            b is not None
            and _is(f["now"], n["inputs"]["capacity_bps"], 1e6)
            and _is(f["then"], b["inputs"]["capacity_bps"], 1e6)
        ),
    ),
    (
        rf"The quality is (?P<now>{NUMBER}), (?P<then>{NUMBER}) then\.",
        lambda f, n, b, s: (
            b is not None
            and _is(f["now"], n["decision"]["quality"])
            and _is(f["then"], b["decision"]["quality"])
        ),
    ),
    (
        rf"Q_min is (?P<now>{NUMBER}), (?P<then>{NUMBER}) then\.",
        lambda f, n, b, s: (
            b is not None
            and _near(f["now"], n["weighed"]["q_min"])
            and _near(f["then"], b["weighed"]["q_min"])
        ),
    ),
    (
        rf"The policy was (?P<policy>{NAME}) then\.",
        lambda f, n, b, s: (
            b is not None and f["policy"] == b["decision"]["policy"] != n["decision"]["policy"]
        ),
    ),
    (
        rf"The link bounds it: a frame may cost (?P<kb>{NUMBER}) kB\.",
        lambda f, n, b, s: (
            "fit" in _verdicts(n) and _is(f["kb"], n["weighed"]["budget_bytes"], 1e3)
        ),
    ),
    (r'Wish (?P<n>\d+)(?: of (?P<operator>.+?))? is in force: "(?P<said>.*)"\.', _wish),
    (
        r'Wish (?P<n>\d+) bound it: "(?P<said>.*)"\.',
        lambda f, n, b, s: any(
            str(one["number"]) == f["n"] and f["said"] in one["bound"] for one in n["intents"]
        ),
    ),
    (
        r"Wish (?P<n>\d+) came\.",
        lambda f, n, b, s: b is not None and f["n"] in _wishes(n) - _wishes(b),
    ),
    (
        r"Wish (?P<n>\d+) ended\.",
        lambda f, n, b, s: b is not None and f["n"] in _wishes(b) - _wishes(n),
    ),
    (r"Robots' own links bound it\.", lambda f, n, b, s: "link" in _verdicts(n)),
    (
        rf"Q_min is not reached: (?P<q>{NUMBER}) of (?P<min>{NUMBER})\.",
        lambda f, n, b, s: (
            not _reach(n, "ours")
            and _is(f["q"], n["decision"]["quality"])
            and _near(f["min"], n["weighed"]["q_min"])
        ),
    ),
    (
        rf"Q_min bounds it: (?P<min>{NUMBER}) must be reached\.",
        lambda f, n, b, s: "q_min" in _verdicts(n) and _near(f["min"], n["weighed"]["q_min"]),
    ),
    (r"Nothing else could be chosen\.", lambda f, n, b, s: n["weighed"]["other"] is None),
    (
        rf"The best other choice, (?:(?P<nobody>nobody)|(?P<helpers>{NAMES}) with "
        rf"(?P<algorithm>{NAME}) fusion at (?P<rate>[\d.e+-]+) Hz), would give quality "
        rf"(?P<quality>{NUMBER}) for (?P<kb>{NUMBER}) kB a frame: less its cost "
        rf"(?P<value>{NUMBER}), against (?P<against>{NUMBER})\.",
        _other,
    ),
    (
        rf"It would miss Q_min, (?P<min>{NUMBER})\.",
        lambda f, n, b, s: (
            _reach(n, "ours") and not _reach(n, "other") and _near(f["min"], n["weighed"]["q_min"])
        ),
    ),
    (
        r"It would reach Q_min, but (?P<who>.+) chose otherwise\.",
        lambda f, n, b, s: not _reach(n, "ours") and _reach(n, "other") and _who(f, n),
    ),
    (r"It is no better\.", lambda f, n, b, s: (gain := _gain(n)) is not None and gain <= 0),
    (
        rf"It is better by no more than (?P<gain>{NUMBER}), and no change pays for that\.",
        _small,
    ),
    (
        rf"The decision has stood for (?P<held>{NUMBER}) s, and stays (?P<dwell>{NUMBER}) s "
        r"unless it must go\.",
        _stays,
    ),
    (
        rf"It costs more, and would leave less than (?P<p>{NUMBER}) % of the link free\.",
        _reserve,
    ),
    (r"It is better, but (?P<who>.+) chose otherwise\.", _better),
    (
        r"This line does not say what robots add and cost, nor what else could be chosen: it is "
        r"of an older program, or the scene could not be told\.",
        lambda f, n, b, s: n.get("weighed") is None,
    ),
    (
        r"The journal holds no other decision before this one\.",
        lambda f, n, b, s: b is None,
    ),
]
