"""Who sends what, and how often: choices in which robots differ in algorithm and rate.

An option of a robot is an algorithm and a rate. At a lower rate it counts as one that arrives less
often, by what is left of its worth; each arrives or not on its own, so a place that several show in
turn is fresher than what one of them shows. With one algorithm at the usual rate that is the
quality of `Scorer` (docs/decision.md).

The search is greedy: a robot joins with an option, or goes on to one that is more, whichever brings
most for its bytes, or most, while all budgets last. Quality is a sum of expected coverages, so it
is monotone and submodular in such steps; the better of the two orders reaches what is stated in
greedy.py of the best steps, where no budget but the link's binds.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ego_agent.knowledge.answers import UNTRIED
from ego_agent.knowledge.own_costs import LIGHTER
from ego_agent.knowledge.pace import about_places, every_nth, in_step, in_turn
from ego_agent.plan.choices.scoring import PREFERRED, Score, Scorer
from swarm.messages import MIXED, Algorithm, Assignment

Floats = NDArray[np.float64]

SMALLEST_GAIN = 1e-6
"""Less is a rounding error, not quality."""
NOBODY = -1
CALMER = 0.8
"""Of the budget, where the largest frame would not come in time."""


@dataclass(frozen=True, slots=True)
class Option:
    """What a robot may send."""

    algorithm: Algorithm
    rate_hz: float
    gain: float
    """Quality of showing everything with the algorithm, in every frame, to an ego that sees
    nothing."""
    kept: float
    """What is left of that at the rate."""
    places_hz: float = 0.0
    """How often a robot that can tell of places alone is asked about them, where it does not
    contribute anyway..."""
    between_hz: float = 0.0
    """...which is so often beside its contributions, on average."""
    kept_between: float = 0.0
    """What is left of the gain then."""
    objects_only: bool = False
    """Whether it sends only what may be an object, where it is asked about places."""


@dataclass(frozen=True, slots=True)
class Brought:
    """What a candidate brings to a choice, or would bring."""

    sends: Assignment
    adds: float
    """Quality."""
    costs: float
    """lambda C of it, in quality."""
    fits: bool
    """Whether the link carries it on average."""


@dataclass(slots=True)
class _Growing:
    """A choice on its way. Rows are candidates, a level is what an algorithm gains."""

    chosen: NDArray[np.intp]
    """(n,): number of each candidate's option, or NOBODY."""
    shown: Floats
    """(n, level): probability that what the candidate shows counts, by what algorithms gain."""
    missed: NDArray[np.float32]
    """(level, columns): probability that nobody shows it with an algorithm that gains so much."""
    share: Floats
    """(level,): part of all that is seen, the ego's included."""
    bytes: float = 0.0
    """Mean of a fused frame."""
    busy_s: float = 0.0
    """The ego's processor time for contributions, a second."""
    barred: NDArray[np.bool_] = field(default_factory=lambda: np.zeros((0, 0), dtype=np.bool_))


class Mixes:
    """The options in a scene, at a pace."""

    def __init__(self, scorer: Scorer) -> None:
        """`scorer`: of the scene at the pace."""
        self.scorer = scorer
        self.options = _options(scorer)
        candidates = scorer.scene.candidates
        rates = np.array([option.rate_hz for option in self.options]) / scorer.pace.rate_hz
        self._rate = rates
        """(options,): of fused frames."""
        gains = np.array([option.gain for option in self.options])
        self._steps = np.unique(gains[gains > 0.0])
        self._rise = np.diff(self._steps, prepend=0.0)
        """(level,): gain from each algorithm's to the next."""
        shape = (len(candidates), len(self.options))
        takes, prices, adds, counts = (np.zeros(shape) for _ in range(4))
        self._asks, self._objects = np.zeros((2, *shape), dtype=np.bool_)
        """(n, options): whether the candidate is asked about places in between, and sends only what
        may be an object."""
        self.able = np.zeros(shape, dtype=np.bool_)
        """(n, options): whether the candidate can, for itself."""
        for o, option in enumerate(self.options):
            name = option.algorithm
            arrival = scorer.counting(name)[1:]
            for i, candidate in enumerate(candidates):
                if name not in candidate.sizes:
                    continue
                asks = option.places_hz > 0.0 and candidate.tells_places(name)
                between_hz = option.between_hz if asks else 0.0
                more = between_hz / scorer.pace.rate_hz
                only = asks and option.objects_only and candidate.sends_objects(name)
                price = scorer.objects_price if only else scorer.price
                takes[i, o] = candidate.contribution_size(name, objects_only=only) * rates[o]
                takes[i, o] += candidate.places_size(name) * more
                prices[i, o] = price(i + 1, name) * rates[o]
                prices[i, o] += scorer.places_price(i + 1, name) * more
                prices[i, o] -= PREFERRED if candidate.robot in scorer.scene.preferred else 0.0
                whole_hz = option.rate_hz + LIGHTER * between_hz
                adds[i, o] = scorer.knowledge.add_s(name) * whole_hz
                counts[i, o] = arrival[i] * (option.kept_between if asks else option.kept)
                self._asks[i, o], self._objects[i, o] = asks, only
                self.able[i, o] = _able(scorer, i, option, between_hz, objects_only=only)
        self._takes, self._prices, self._adds = takes, prices, adds
        """(n, options): bytes of a fused frame on average; lambda C; the ego's seconds a second."""
        reaches = gains[:, None] >= self._steps - 1e-12
        self._shown = counts[:, :, None] * reaches
        """(n, options, level)."""
        self._seen, self._weights = scorer.views.patterns
        self._spare_s = 1.0 - scorer.knowledge.fixed_s() * scorer.pace.rate_hz

    def grow(self, *, by_byte: bool) -> Score:
        """The choice that the greedy order finds: until nothing is worth its price, and Q_min is
        reached or nothing adds to it."""
        budget = float(self.scorer.budget_bytes)
        while True:
            found = self._grown(self._nobody(), budget, by_byte=by_byte)
            score = self.score_of(found)
            if not score.participants or self.carries(score):
                return score
            budget *= CALMER

    def rated(self, participants: Sequence[str], algorithm: Algorithm) -> Score:
        """These robots with that algorithm, each at its best rate: all of them where the link
        carries all at their lowest rates, else those who bring most for their bytes."""
        if not all(self.sends(robot, algorithm) for robot in participants):
            return self.scorer.score(participants, algorithm)
        return self.rated_as(dict.fromkeys(participants, algorithm))

    def rated_as(self, forms: Mapping[str, Algorithm]) -> Score:
        """The same of robots with an algorithm each, without those who cannot send it."""
        lowest, barred = {}, np.ones_like(self.able)
        for robot, algorithm in forms.items():
            i = self.scorer.row_of[robot] - 1
            same = [o for o, option in enumerate(self.options) if option.algorithm == algorithm]
            barred[i, same] = ~self.able[i, same]
            if not barred[i].all():
                lowest[i] = int(np.where(barred[i], np.inf, self._rate).argmin())
        least = sum(self._takes[i, o] for i, o in lowest.items())
        budget = float(self.scorer.budget_bytes)
        while True:
            growing, everyone = self._nobody(), least <= budget + 1e-6
            growing.barred = barred
            if everyone:
                for i, o in lowest.items():
                    self._take(growing, i, o)
            score = self.score_of(self._grown(growing, budget, by_byte=not everyone))
            # Who takes part is given: an ego that is too busy for them is no reason for fewer.
            if not score.participants or self.passes(score):
                return score
            budget *= CALMER

    def score(self, assignments: Sequence[Assignment]) -> Score | None:
        """The score of a choice; None where a robot cannot send what is assigned to it."""
        if not all(self.can(one) for one in assignments):
            return None
        return self.score_of(self._grow_to(assignments))

    def score_able(self, assignments: Sequence[Assignment]) -> Score:
        """The score of a choice without robots that cannot send what is assigned to them."""
        return self.score_of(self._grow_to([one for one in assignments if self.can(one)]))

    def _grow_to(self, assignments: Sequence[Assignment]) -> _Growing:
        growing = self._nobody()
        for one in assignments:
            o = self.option(one.algorithm, one.rate_hz)
            if o is not None:
                self._take(growing, self.scorer.row_of[one.robot] - 1, o)
        return growing

    def brought(self, assignments: Sequence[Assignment]) -> dict[str, Brought]:
        """What each candidate brings to a choice beside the others, or would bring with the option
        that is worth most beyond its price; without those that can send nothing."""
        sends = {one.robot: one for one in assignments if self.can(one)}
        growing = self._grow_to([*sends.values()])
        _, gains = self._gains(growing, self.scorer.knowledge.quality.enough)
        net = np.where(self.able, gains - self._prices, -np.inf)
        quality, found = self._quality(growing), {}
        for i, candidate in enumerate(self.scorer.scene.candidates):
            one = sends.get(candidate.robot)
            if one is not None:
                o = growing.chosen[i]
                others = [other for other in sends.values() if other is not one]
                adds, fits = quality - self._quality(self._grow_to(others)), True
            elif self.able[i].any():
                o = int(net[i].argmax())
                one = self.assignment(candidate.robot, o)
                more = self._takes[i, o]
                adds = min(float(gains[i, o]), 1.0 - quality)
                fits = growing.bytes + more <= self.scorer.budget_bytes + 1e-6
            else:
                continue
            found[candidate.robot] = Brought(one, adds, float(self._prices[i, o]), bool(fits))
        return found

    def can(self, one: Assignment) -> bool:
        """Whether a robot is a candidate that can send what is assigned to it."""
        o = self.option(one.algorithm, one.rate_hz)
        i = self.scorer.row_of.get(one.robot, 0) - 1
        return o is not None and i >= 0 and bool(self.able[i, o])

    def sends(self, robot: str, algorithm: Algorithm) -> bool:
        """Whether a candidate can send with the algorithm, at any rate."""
        return any(one.algorithm == algorithm for one in self.options_of(robot))

    def options_of(self, robot: str) -> list[Assignment]:
        """What a candidate can send."""
        able = np.flatnonzero(self.able[self.scorer.row_of[robot] - 1])
        return [self.assignment(robot, int(o)) for o in able]

    def assignment(self, robot: str, o: int) -> Assignment:
        """That of an option, by its number, to a candidate."""
        option, i = self.options[o], self.scorer.row_of[robot] - 1
        return Assignment(
            robot=robot,
            algorithm=option.algorithm,
            rate_hz=option.rate_hz,
            places_hz=option.places_hz if self._asks[i, o] else 0.0,
            objects_only=bool(self._objects[i, o]),
        )

    def takes(self, robot: str, o: int) -> float:
        """Bytes of a fused frame on average that an option of a candidate takes."""
        return float(self._takes[self.scorer.row_of[robot] - 1, o])

    def option(self, algorithm: str, rate_hz: float) -> int | None:
        """The number of an option; None where there is no such one."""
        for o, option in enumerate(self.options):
            if (option.algorithm, option.rate_hz) == (algorithm, rate_hz):
                return o
        return None

    def score_of(self, growing: _Growing) -> Score:
        """What the choice brings and costs."""
        scorer = self.scorer
        rows = np.flatnonzero(growing.chosen != NOBODY)
        chosen = {int(i): int(growing.chosen[i]) for i in rows}
        taken = {i: self.options[o] for i, o in chosen.items()}
        names = tuple(scorer.scene.candidates[i].robot for i in taken)
        kinds = {option.algorithm for option in taken.values()}
        usual = all(option.rate_hz == scorer.pace.rate_hz for option in taken.values())
        if len(kinds) <= 1 and usual:
            return scorer.score(names, next(iter(kinds), scorer.knowledge.best_algorithm()))
        price = float(self._prices[rows, growing.chosen[rows]].sum())
        a_frame = round(sum(option.rate_hz for option in taken.values()) / scorer.pace.rate_hz)
        fresh = min(scorer.freshness(kind, a_frame) for kind in kinds)
        quality = self._quality(growing) * fresh
        return Score(
            participants=names,
            algorithm=next(iter(kinds)) if len(kinds) == 1 else MIXED,
            quality=quality,
            cost_bytes=math.ceil(growing.bytes - 1e-6),
            value=quality - price,
            pace=scorer.pace,
            assignments=tuple(
                self.assignment(name, o) for name, o in zip(names, chosen.values(), strict=True)
            ),
        )

    def carries(self, score: Score) -> bool:
        """Whether the link carries a choice, its largest frame within the deadline, and the ego
        takes it up."""
        busy_s = sum(
            self._adds[self.scorer.row_of[one.robot] - 1, o]
            for one in score.assignments
            if (o := self.option(one.algorithm, one.rate_hz)) is not None
        )
        return self.passes(score) and (not score.assignments or busy_s <= self._spare_s)

    def passes(self, score: Score) -> bool:
        """Whether the link carries a choice, its largest frame within the deadline."""
        return self.scorer.fits(score) and (not score.assignments or self._bursts_fit(score))

    def _bursts_fit(self, score: Score) -> bool:
        scorer = self.scorer
        sizes = {one.robot: scorer.size(one.robot, one.algorithm) for one in score.assignments}
        candidates = scorer.scene.candidates
        places = {
            one.robot: candidates[scorer.row_of[one.robot] - 1].places_size(one.algorithm)
            for one in score.assignments
        }
        largest = burst(score.assignments, scorer.pace.rate_hz, sizes, places)
        return largest <= scorer.budget_bytes * _frames(scorer)

    def _nobody(self) -> _Growing:
        n, levels = len(self.able), len(self._steps)
        return _Growing(
            chosen=np.full(n, NOBODY, dtype=np.intp),
            shown=np.zeros((n, levels)),
            missed=np.ones((levels, len(self._weights)), dtype=np.float32),
            share=np.full(levels, self.scorer.own_share),
            barred=np.zeros_like(self.able),
        )

    def _grown(self, growing: _Growing, budget: float, *, by_byte: bool) -> _Growing:
        enough = self.scorer.knowledge.quality.enough
        q_min = self.scorer.objective.q_min
        rows = np.arange(len(self.able))
        while len(rows):
            more, gain = self._gains(growing, enough)
            now = growing.chosen
            joined = now != NOBODY
            price = np.where(joined, self._prices[rows, now], 0.0)
            size = np.where(joined, self._takes[rows, now], 0.0)
            busy = np.where(joined, self._adds[rows, now], 0.0)
            further = self._takes - size[:, None]
            can = self.able & more & ~growing.barred & (growing.bytes + further <= budget + 1e-6)
            can &= growing.busy_s + self._adds - busy[:, None] <= self._spare_s
            net = gain - (self._prices - price[:, None])
            worth = np.where(can, net / np.maximum(further, 1.0) if by_byte else net, -np.inf)
            if worth.max(initial=-np.inf) <= SMALLEST_GAIN * (1e-3 if by_byte else 1.0):
                if self._quality(growing) >= q_min:
                    break
                # What Q_min takes goes before what it costs.
                worth = np.where(can & (gain > SMALLEST_GAIN), gain / np.maximum(further, 1.0), 0.0)
                if worth.max(initial=0.0) <= 0.0:
                    break
            i, o = np.unravel_index(int(np.argmax(worth)), worth.shape)
            self._take(growing, int(i), int(o))
        return growing

    def _gains(self, growing: _Growing, enough: float) -> tuple[NDArray[np.bool_], Floats]:
        """(n, options): whether each option is more than what its candidate does, and the quality
        that it adds."""
        adds = (self._seen @ (growing.missed * self._weights).T).astype(np.float64)
        left = 1.0 - growing.shown
        rest = np.divide(1.0, left, out=np.zeros_like(left), where=left > 1e-9)
        rises = self._shown - growing.shown[:, None, :]
        extra = rises * rest[:, None, :]
        # Also of what is certain, to which nothing can be added, nothing may be lost.
        more: NDArray[np.bool_] = (rises.min(axis=2) >= -1e-9) & (extra.max(axis=2) > 1e-9)
        room = np.maximum(0.0, enough - growing.share)
        gain: Floats = np.minimum(adds[:, None, :] * extra, room) @ self._rise
        return more, gain

    def _take(self, growing: _Growing, i: int, o: int) -> None:
        """The candidate goes on with the option."""
        before = growing.chosen[i]
        now = np.maximum(growing.shown[i], self._shown[i, o])
        # What it has shown so far is taken out first; of what is certain nothing is left to add.
        rises = (now > growing.shown[i]) & (growing.shown[i] < 1.0)
        seen = self._seen[i]
        was = 1.0 - growing.shown[i, rises].astype(np.float32)[:, None] * seen
        left = growing.missed[rises] * ((1.0 - now[rises].astype(np.float32)[:, None] * seen) / was)
        growing.share[rises] += (growing.missed[rises] - left) @ self._weights
        growing.missed[rises] = left
        growing.shown[i] = now
        growing.bytes += self._takes[i, o]
        growing.busy_s += self._adds[i, o]
        if before != NOBODY:
            growing.bytes -= self._takes[i, before]
            growing.busy_s -= self._adds[i, before]
        growing.chosen[i] = o

    def _quality(self, growing: _Growing) -> float:
        model, own = self.scorer.knowledge.quality, self.scorer.own_share
        alone = model.quality(self.options[0].algorithm, own, own, self.scorer.known_part)
        shown = np.minimum(growing.share, model.enough) - min(own, model.enough)
        return min(1.0, alone + float(np.maximum(0.0, shown) @ self._rise))


def burst(
    assignments: Sequence[Assignment],
    frames_hz: float,
    sizes: Mapping[str, int],
    places: Mapping[str, int] = MappingProxyType({}),
) -> int:
    """Bytes of the largest of the fused frames, of robots that take turns, by those of their
    contributions and of their answers about places."""
    rates = {one.robot: one.rate_hz for one in assignments}
    every = [*rates.values(), *(one.places_hz for one in assignments if one.places_hz > 0.0)]
    cycle = math.lcm(*(every_nth(hz, frames_hz) for hz in every))
    return max(
        sum(sizes[robot] for robot in in_turn(rates, frames_hz, number))
        + sum(places.get(robot, 0) for robot in about_places(assignments, frames_hz, number))
        for number in range(cycle)
    )


def _options(scorer: Scorer) -> tuple[Option, ...]:
    """What robots may send at the pace, most often first."""
    known, usual_hz = scorer.knowledge, scorer.pace.rate_hz
    rates = {usual_hz, *(in_step(hz, usual_hz) for hz in scorer.objective.rarer_hz)}

    def option(name: Algorithm, hz: float) -> Option:
        gain, kept = known.quality.gain(name), known.rates.kept(name, hz, usual_hz)
        asked_hz = known.places_hz(name, hz)
        places_hz = in_step(asked_hz, usual_hz) if asked_hz > 0.0 else 0.0
        if hz >= places_hz:
            return Option(name, hz, gain, kept)
        # Frames to which it contributes do not ask it about places.
        between_hz = places_hz * (1.0 - hz / usual_hz)
        with_places = known.rates.kept(name, hz, usual_hz, places_hz)
        only = known.rates.objects_suffice(name, hz, places_hz)
        return Option(name, hz, gain, kept, places_hz, between_hz, with_places, only)

    return tuple(
        option(name, hz)
        for name in known.algorithms
        if name in known.mixable
        for hz in sorted(rates, reverse=True)
    )


def _frames(scorer: Scorer) -> float:
    """Frames in whose time the largest one must be through."""
    return max(1.0, scorer.pace.deadline_s * scorer.pace.rate_hz)


def _able(scorer: Scorer, i: int, option: Option, between_hz: float, *, objects_only: bool) -> bool:
    """Whether a candidate's own link and processor carry an option, with so many answers about
    places a second, and the cell one contribution within the deadline."""
    candidate, name = scorer.scene.candidates[i], option.algorithm
    usual = option.rate_hz >= scorer.pace.rate_hz
    a_second = candidate.contribution_size(name, objects_only=objects_only) * option.rate_hz
    a_second += candidate.places_size(name) * between_hz
    share = (option.rate_hz + between_hz) / scorer.pace.rate_hz
    # At a lower rate the robot is asked on its own, not heard with others.
    needs_bps = scorer.needs_bps(candidate.robot, name) if usual else 8.0 * a_second
    if needs_bps > scorer.allowed_bps(candidate.robot):
        return False
    if candidate.sizes[name] > scorer.budget_bytes * _frames(scorer):
        return False
    encode_s = scorer.knowledge.encode_s(name, candidate.answers.get(name, UNTRIED).encode_s)
    return encode_s * scorer.pace.rate_hz * share <= 1.0 or name in candidate.shared
