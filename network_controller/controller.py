"""The controller: carries out wishes, measures links, and runs the slow loop.

One lock keeps operators, API sessions and the loop apart; whoever comes second sees what the first
one did. Drivers are called under it only.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any, Concatenate, ParamSpec, TypeVar, cast

from network_controller import ladder
from network_controller.drivers.base import Driver
from network_controller.enforce import Enforcer
from network_controller.journal import Journal
from network_controller.metrics import ControllerMetrics
from network_controller.model import Link, LinkShape
from network_controller.observe import Observer, link_state
from network_controller.requests import CONGEST_S, UTILISATION, links_of, wish_of
from network_controller.slow_loop import Action, Load, SlowLoop
from network_controller.telemetry.flows import Flows
from network_controller.wishes import Wish, Wishes
from swarm.errors import NetworkError
from swarm.log import Logger
from swarm.messages import LinkState, NetDemand, ShapeInForce, ShapeReply, ShapeRequest
from swarm.process import Clock

STATE_S = 1.0
MIN_WAIT_S = 0.005
RETRY_S = 1.0

P = ParamSpec("P")
R = TypeVar("R")


def _locked(
    method: Callable[Concatenate[Controller, P], R],
) -> Callable[Concatenate[Controller, P], R]:
    @wraps(method)
    def run(self: Controller, *args: P.args, **kwargs: P.kwargs) -> R:
        with self._lock:
            return method(self, *args, **kwargs)

    return cast("Callable[Concatenate[Controller, P], R]", run)


class Controller:
    """The links of one swarm on one host."""

    def __init__(
        self,
        driver: Driver,
        wishes: Wishes,
        loop: SlowLoop,
        flows: Flows,
        metrics: ControllerMetrics,
        journal: Journal | None,
        log: Logger,
        *,
        ego: str,
        clock: Clock | None = None,
        on_lost: Callable[[str], None] = lambda robot: None,
    ) -> None:
        """`on_lost(robot)` hears that nothing can be promised on a robot's link any more."""
        self._driver = driver
        self._wishes = wishes
        self._loop = loop
        self._flows = flows
        self._metrics = metrics
        self._journal = journal
        self._log = log
        self._ego = ego
        self._clock = clock or Clock()
        self.on_lost = on_lost
        self._enforcer = Enforcer(driver, self._link_event)
        self._observer = Observer(metrics)
        self._holds: dict[str, tuple[str, int]] = {}
        self._robots: Mapping[str, str] = {}
        self._lock = threading.RLock()
        self._wake = threading.Event()
        self._unready = ""
        self._lost: list[str] = []

    @_locked
    def start(self) -> None:
        """Takes over the links that an earlier controller shaped and that are still wanted, and
        clears the others. A kernel that cannot shape is told of, and asked again later."""
        self._look_around()
        if self._unready:
            return
        wanted = self._wanted()
        readings = self._driver.read(self._driver.shaped())
        for link, reading in readings.items():
            level = ladder.level_of({t: c.shape for t, c in reading.classes.items()})
            if link in wanted and level is not None:
                self._loop.levels[link] = level
                shape = ladder.shape(reading.capacity_bps, level)
                self._enforcer.adopt(link, shape)
                self._note("adopted", "an earlier controller shaped it", link, level=level)
        for link in self._driver.shaped() - self._enforcer.links() - set(wanted):
            self._driver.clear(link)
            self._note("cleared", "an earlier controller left it, and nobody wants it", link)
        self._enforcer.reconcile(self._wanted())

    def run(self, stop: threading.Event, publish: Callable[[tuple[LinkState, ...]], None]) -> None:
        """Follows profiles and measures until `stop` is set; `publish` gets the states, 1 Hz."""
        state_due = time.monotonic()
        while not stop.is_set():
            self._wake.clear()
            try:
                self.follow()
                if time.monotonic() >= state_due:
                    late = int((time.monotonic() - state_due) / STATE_S)
                    state_due += (1 + late) * STATE_S
                    publish(self.observe())
            except NetworkError as error:
                self._log.error("step_failed", error=str(error))
            except Exception:
                # One broken step must not leave links without anybody who follows their profile.
                self._log.error("step_failed", exc_info=True)
            self._tell_lost()
            due_s = min(state_due - time.monotonic(), self._next_change_s())
            self._wake.wait(max(MIN_WAIT_S, due_s))

    def wake(self) -> None:
        """Has `run` look again at once: at what has changed, or whether it should stop."""
        self._wake.set()

    @_locked
    def follow(self) -> None:
        """Ends what has expired, and brings links to what is wanted now."""
        expired = self._wishes.expire(self._clock.now_ns())
        if expired:
            for wish in expired:
                self._note("expired", f"the shape of {wish.operator} has ended", wish.link)
            self._wishes.changed()
        if not self._unready:
            self._enforcer.reconcile(self._wanted())

    @_locked
    def observe(self) -> tuple[LinkState, ...]:
        """Reads all counters, takes the slow loop's steps, and returns the links' states."""
        self._look_around()
        now_s = time.monotonic()
        readings = self._driver.read(self._enforcer.links())
        self._enforcer.check(readings, self._robots)
        classes = self._observer.look(readings, now_s)
        loads = {link: self._observer.load(link, reading) for link, reading in readings.items()}
        self._act({k: v for k, v in loads.items() if k in self._enforcer.links()}, now_s)
        demands = self._loop.demands(now_s)
        needs = {ego: 8.0 * demand.needed_bytes_s for ego, demand in demands.items()}
        states = tuple(
            link_state(
                link,
                reading,
                classes[link],
                loads[link],
                self._level(link),
                # An ego's cell is its own; what comes from a robot may be for every ego.
                dict.fromkeys(needs, math.inf) if link.direction == "up" else {},
            )
            for link, reading in sorted(readings.items())
        )
        self._metrics.show(states)
        self._metrics.show_demands(
            {ego: (d.needed_bytes_s, d.unreachable_s) for ego, d in demands.items()}
        )
        if self._journal is not None:
            self._metrics.journal_lost.set(self._journal.lost)
        return states

    def on_demand(self, demand: NetDemand) -> None:
        """Takes an ego's demand; never waits long, so it may be called on Zenoh's threads."""
        self._loop.on_demand(demand, time.monotonic())

    @_locked
    def request(self, request: ShapeRequest) -> ShapeReply:
        """Carries out an operator's request, all of it or nothing.

        Raises NetworkError that says why not.
        """
        try:
            notes = self._carry_out(request)
        except NetworkError as error:
            self._metrics.requests.labels(request.profile, "refused").inc()
            if request.profile != "show":
                self._note(
                    "refused",
                    str(error),
                    operator=request.operator,
                    profile=request.profile,
                    robot=request.robot or self._ego,
                )
            raise
        self._metrics.requests.labels(request.profile, "done").inc()
        self._wake.set()
        return ShapeReply(
            request=request.request,
            revision=self._wishes.revision,
            shapes=self._in_force(),
            congested=tuple(sorted(self._flows.running())),
            notes=(*notes, *(f"{k}: {v}" for k, v in sorted(self._enforcer.problems.items()))),
        )

    def _carry_out(self, request: ShapeRequest) -> tuple[str, ...]:
        if request.profile == "show":
            return (self._unready,) if self._unready else ()
        if request.revision is not None and request.revision != self._wishes.revision:
            raise NetworkError(
                f"the shapes have revision {self._wishes.revision}, not {request.revision}: "
                "somebody else has changed them; look at them again first"
            )
        if self._unready:
            raise NetworkError(self._unready)
        self._robots = self._driver.robots()
        if request.profile == "congest":
            return self._congest(request)
        before = self._wishes.copy()
        notes: tuple[str, ...] = ()
        if request.profile == "off":
            if request.robot:
                links = links_of(request, self._ego, frozenset(self._robots))
                self._flows.stop(request.robot)
            else:
                links = tuple(before)
                self._flows.stop()
            for link in links:
                self._wishes.drop(link)
        else:
            links = links_of(request, self._ego, frozenset(self._robots))
            notes = tuple(
                f"{link}: this replaces the shape of {old.operator}"
                for link in links
                if (old := self._wishes.get(link)) is not None
                and old.layer != "start"
                and old.operator != request.operator
            )
            for link in links:
                self._wishes.put(wish_of(request, link, self._clock.now_ns()))
        wanted = self._wanted()
        applied = {link: self._enforcer.shape_of(link) for link in links}
        try:
            self._enforcer.change({link: wanted.get(link) for link in links})
            self._wishes.changed()
        except NetworkError:
            self._metrics.failures.inc()
            self._wishes.restore(before)
            self._enforcer.change(applied)
            raise
        for link in links:
            wish = self._wishes.get(link)
            if wish is None:
                self._loop.forget(link)
                self._lost.append(link.robot)
            self._note(
                "shaped" if request.profile != "off" else "shape_ended",
                f"asked for by {request.operator or 'unknown'}",
                link,
                profile=request.profile,
                rate_bps=wanted[link].capacity_bps if link in wanted else None,
                until_ns=wish.until_ns if wish is not None else 0,
            )
        return notes

    def _congest(self, request: ShapeRequest) -> tuple[str, ...]:
        (link, *_) = links_of(request, self._ego, frozenset(self._robots))
        shape = self._enforcer.shape_of(Link(link.robot, "down"))
        rate_bps = request.rate_bps
        if rate_bps is None:
            if shape is None:
                raise NetworkError(
                    f"the link towards {link.robot} is not shaped, so it has no "
                    f"{UTILISATION:.0%}; name a rate, or shape the link first"
                )
            rate_bps = round(UTILISATION * shape.capacity_bps)
        seconds = request.duration_s or CONGEST_S
        self._flows.start(link.robot, rate_bps, seconds, request.protocol)
        why = f"asked for by {request.operator or 'unknown'}"
        self._note("congested", why, link, rate_bps=rate_bps, seconds=seconds)
        return (f"{rate_bps / 1e6:.2f} Mbit/s of telemetry towards {link.robot} for {seconds:g} s",)

    @_locked
    def robot_at(self, ipv4: str) -> str | None:
        """Whose link has this address, or None."""
        self._robots = self._driver.robots()
        return next((robot for robot, address in self._robots.items() if address == ipv4), None)

    @_locked
    def capacity_bps(self, robot: str) -> int | None:
        """Capacity of a robot's link downwards; None where it is not shaped."""
        shape = self._enforcer.shape_of(Link(robot, "down"))
        return None if shape is None else shape.capacity_bps

    @_locked
    def hold(self, session_id: str, robot: str, level: int) -> None:
        """Keeps a robot's link at a level or above, until `release`. Raises NetworkError."""
        link = Link(robot, "down")
        before = self._holds.get(session_id)
        if link not in self._enforcer.links():
            raise NetworkError(f"the link towards {robot} is not shaped: nothing can be promised")
        self._holds[session_id] = (robot, level)
        try:
            self._enforcer.change({link: self._wanted()[link]})
        except NetworkError:
            self._metrics.failures.inc()
            if before is None:
                del self._holds[session_id]
            else:
                self._holds[session_id] = before
            raise
        self._note("held", f"session {session_id}", link, level=self._level(link))

    @_locked
    def release(self, session_id: str) -> None:
        """Ends a hold. The link falls to the level that others still need."""
        robot, _ = self._holds.pop(session_id, ("", 0))
        if robot:
            link = Link(robot, "down")
            self._enforcer.reconcile(self._wanted())
            self._note("released", f"session {session_id}", link, level=self._level(link))

    @_locked
    def close(self) -> None:
        """Ends telemetry flows and makes all links unshaped; the wishes are kept for the next
        start. Only a controller that is killed leaves shapes behind, which `start` finds."""
        self._flows.close()
        self._enforcer.reconcile({})
        self._driver.close()

    def _act(self, loads: Mapping[Link, Load], now_s: float) -> None:
        for action in self._loop.tick(loads, now_s):
            self._take(action)

    def _take(self, action: Action) -> None:
        """One step of the slow loop, if the kernel takes it."""
        before = self._level(action.link)
        self._loop.done(action)
        facts = {"level": self._level(action.link), "before": before}
        wanted = self._wanted().get(action.link)
        try:
            self._enforcer.change({action.link: wanted})
        except NetworkError as error:
            self._metrics.failures.inc()
            self._loop.levels[action.link] = action.before
            self._note("step_failed", str(error), action.link, **facts)
            return
        name = "raised" if action.after > action.before else "lowered"
        self._note(name, action.reason, action.link, **facts)

    def _look_around(self) -> None:
        """Which robots are here, and whether links can be shaped at all."""
        try:
            self._robots = self._driver.robots()
            if self._unready or not self._enforcer.links():
                self._driver.capabilities()
        except NetworkError as error:
            if str(error) != self._unready:
                self._note("unready", str(error))
            self._unready = str(error)
            return
        if self._unready:
            self._note("ready", "links can be shaped again")
        self._unready = ""

    def _wanted(self) -> dict[Link, LinkShape]:
        now_ns = self._clock.now_ns()
        return {wish.link: self._shape(wish, now_ns) for wish in self._wishes}

    def _shape(self, wish: Wish, now_ns: int) -> LinkShape:
        rate_bps = wish.rate_bps(now_ns)
        level = self._level(wish.link)
        return ladder.shape(rate_bps, level, delay_ms=wish.delay_ms, loss=wish.loss)

    def _level(self, link: Link) -> int:
        """What the slow loop says, or a session that needs more."""
        held = [level for robot, level in self._holds.values() if Link(robot, "down") == link]
        return max([self._loop.level(link), *held])

    def _next_change_s(self) -> float:
        with self._lock:
            if self._enforcer.problems or self._unready:
                return RETRY_S
            now_ns = self._clock.now_ns()
            changes = [wish.next_change_ns(now_ns) for wish in self._wishes]
            return (min(changes, default=math.inf) - now_ns) / 1e9

    def _in_force(self) -> tuple[ShapeInForce, ...]:
        now_ns = self._clock.now_ns()
        return tuple(
            ShapeInForce(
                robot=wish.robot,
                direction=wish.direction,
                profile=wish.kind,
                rate_bps=wish.rate_bps(now_ns) if wish.link in self._enforcer.links() else 0,
                operator=wish.operator,
                since_ns=wish.since_ns,
                until_ns=wish.until_ns,
                delay_ms=wish.delay_ms,
                loss=wish.loss,
            )
            for wish in sorted(self._wishes, key=lambda wish: wish.link)
        )

    def _link_event(self, action: str, reason: str, link: Link) -> None:
        self._note(action, reason, link)
        if action == "link_gone":
            self._loop.forget(link)
            self._lost.append(link.robot)

    def _tell_lost(self) -> None:
        """Outside the lock: who hears of it may call back."""
        with self._lock:
            lost, self._lost = self._lost, []
        for robot in lost:
            self.on_lost(robot)

    def _note(self, action: str, reason: str, link: Link | None = None, **facts: Any) -> None:
        """Explains an action in the journal, the log and the metrics."""
        if link is not None:
            facts = {"robot": link.robot, "direction": link.direction, **facts}
        self._metrics.actions.labels(action).inc()
        self._log.info(action, reason=reason, **facts)
        if self._journal is not None:
            self._journal.note(self._clock.now_ns(), action, reason, **facts)
