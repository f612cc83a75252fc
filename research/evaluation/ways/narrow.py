"""Who sends what where a link does not carry everybody's points: decided, static, by chance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from network_controller.profiles import Fixed
from research.evaluation.bootstrap import bootstrap_mean
from research.evaluation.ways.drive import Drive
from research.evaluation.ways.measure import Measured
from research.evaluation.ways.planned import RANDOM, Decided
from research.evaluation.ways.sampling import BETWEEN_HZ
from research.evaluation.ways.way import Way
from research.evaluation.windows import links

OURS = "coverage-assignments"
FREE = "coverage-assignments-free"
"""The same where bytes and processors cost nothing: as good as the link carries."""
DEAR = "coverage-assignments-dear"
DEAR_TIMES = 8.0
"""The same where they cost this many times what they usually do."""
PLAIN = "coverage-assignments-without-places"
"""The same where nobody is asked about places in between."""
SINGLE_FREE = "coverage-free"
SINGLE_POLICIES = ("coverage", "static-early", "static-late", "rules", SINGLE_FREE)
"""Policies that decide one algorithm and one rate for all."""
EVERYONE = "early-10hz-no-memory"
CEILING = "early-10hz-all-arrives"
"""Everybody's points in every frame, with memory, on a link that carries anything: what no choice
can be expected to exceed."""
STATIC = (
    ("early", 10.0, 0.0),
    ("early", 5.0, 0.0),
    ("early", 2.0, 0.0),
    ("early", 2.0, BETWEEN_HZ["factory"][2.0]),
    ("objects", 2.0, BETWEEN_HZ["factory"][2.0]),
    ("early", 1.0, BETWEEN_HZ["factory"][1.0]),
    ("late", 10.0, 0.0),
    ("late", 5.0, 0.0),
)
"""Algorithm (or `objects`: points that may be objects only), contributions a second, and how often
places are asked about in between, of all, whatever the link."""


@dataclass(frozen=True, slots=True)
class Link:
    """A cell, and how many robots share it, the ego counted."""

    name: str
    robots: int
    bps: float


LINKS = (Link("1mbit-6", 6, 1e6), Link("5mbit-24", 24, 5e6), Link("20mbit-6", 6, 20e6))


def ways(link: Link) -> tuple[Way, ...]:
    """What is compared on a link; what all fuse is remembered, but for EVERYONE's."""
    over = links.Link(link.name, Fixed(round(link.bps)))
    return (
        Way(OURS, decided=Decided("coverage", rarer=True), link=over),
        Way(FREE, decided=Decided("coverage", rarer=True, price=0.0), link=over),
        Way(DEAR, decided=Decided("coverage", rarer=True, price=DEAR_TIMES), link=over),
        Way(PLAIN, decided=Decided("coverage", rarer=True, places=False), link=over),
        Way(SINGLE_FREE, decided=Decided("coverage", price=0.0), link=over),
        *(Way(name, decided=Decided(name), link=over) for name in SINGLE_POLICIES[:-1]),
        Way(RANDOM, decided=Decided(RANDOM, rarer=True), link=over),
        *(replace(static(*one), link=over) for one in STATIC),
        Way(EVERYONE, (("early", 10.0),), memory=False, link=over),
        Way(CEILING, (("early", 10.0),)),
    )


def static(form: str, hz: float, places_hz: float) -> Way:
    """Everybody does the same, as in STATIC."""
    objects_only = form == "objects"
    return Way(
        name_of(form, hz, places_hz),
        (("early" if objects_only else form, hz),),
        in_turn=True,
        places_hz=places_hz,
        objects_only=objects_only,
    )


def name_of(form: str, hz: float, places_hz: float) -> str:
    """What a way is called in which everybody does the same."""
    return f"{form}-{hz:g}hz" + (f"-places-{places_hz:g}hz" if places_hz else "")


def drives(link: Link, seeds: range, count: int, frames: int) -> list[Drive]:
    """That many factory floors; egos take turns."""
    return [
        Drive(
            world="factory",
            seed=seeds.start + 10_000 + i,
            robots=link.robots,
            ego=i % link.robots,
            first=53 + i * 577 % 5000,
            frames=frames,
            pose_memory=True,
        )
        for i in range(count)
    ]


def table(link: Link, parts: Sequence[Sequence[Measured]]) -> dict[str, Any]:
    """Rows of all ways, and ours beside each control in pairs of drives. `parts`: by drive, then
    by way."""
    names = [way.name for way in ways(link)]
    rows = {name: _row([part[n] for part in parts]) for n, name in enumerate(names)}

    def best(some: Sequence[str]) -> str:
        return max(some, key=lambda name: float(rows[name]["ap_70"]))

    def beside(way: str, control: str) -> dict[str, Any]:
        ours, theirs = names.index(way), names.index(control)
        gaps = [_ap(part[ours]) - _ap(part[theirs]) for part in parts]
        found = bootstrap_mean(gaps)
        ratio = rows[way]["bytes_per_frame"] / max(1.0, float(rows[control]["bytes_per_frame"]))
        return {
            "way": way,
            "control": control,
            "difference": round(found.mean, 4),
            "interval": [round(found.low, 4), round(found.high, 4)],
            "bytes_ratio": round(ratio, 4),
        }

    controls = {
        "best_single_policy": best(SINGLE_POLICIES),
        "best_static": best([name_of(*one) for one in STATIC]),
        "best_static_without_places": best([name_of(*one) for one in STATIC if not one[2]]),
        "without_places": PLAIN,
        "coverage": "coverage",
        "random": RANDOM,
        "everyone": EVERYONE,
        "ceiling": CEILING,
    }
    return {
        "robots": link.robots,
        "link_bps": link.bps,
        "drives": len(parts),
        "rows": rows,
        "beside": {
            way: {what: beside(way, name) for what, name in controls.items()}
            for way in (OURS, FREE, DEAR)
        },
    }


def _ap(one: Measured) -> float:
    return one.tally.precision().ap_70


def _row(parts: Sequence[Measured]) -> Mapping[str, Any]:
    whole = Measured()
    for at, part in enumerate(parts):
        whole.take_up(part, at)
    found = whole.tally.precision()
    return {
        "ap_70": round(found.ap_70, 4),
        "ap_50": round(found.ap_50, 4),
        "false_per_frame": round(found.false_per_frame, 3),
        "bytes_per_frame": round(whole.bytes / max(1, whole.tally.frames), 1),
        "asked_per_frame": round(whole.asked / max(1, whole.tally.frames), 2),
        "in_time": round(whole.came / max(1, whole.asked), 4),
        "mota": round(whole.following.figures(10.0)["mota"], 4),
        "frames": whole.tally.frames,
    }
