"""The controller: carries out wishes, measures links, and runs the slow loop.

One lock keeps operators, API sessions and the loop apart; whoever comes second sees what the first
one did. Drivers are called under it only.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from typing import Concatenate, ParamSpec, TypeVar, cast

import msgspec

from network_controller import ladder
from network_controller.cell import Cell
from network_controller.drivers.base import Driver
from network_controller.enforce import Enforcer
from network_controller.journal import Journal
from network_controller.metrics import ControllerMetrics
from network_controller.model import Link, lacking, lacking_tree
from network_controller.notes import Notes
from network_controller.observe import Observer, link_state
from network_controller.operators import Operators
from network_controller.queues import QueueWatch
from network_controller.slow_loop import Action, SlowLoop
from network_controller.targets import Targets
from network_controller.telemetry.flows import Flows
from network_controller.wishes import Wishes
from swarm.errors import NetworkError
from swarm.log import Logger
from swarm.loop_watch import Turned, nobody
from swarm.messages import LinkState, NetDemand, ShapeReply, ShapeRequest
from swarm.process import Clock

STATE_S = 1.0
MIN_WAIT_S = 0.005
RETRY_S = 1.0
MAX_HEARD = 1024
RENEW_LOOKS = 5

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
        others: Sequence[str] = (),
        cell: Sequence[str] = (),
        clock: Clock | None = None,
    ) -> None:
        """`others`: robots whose links are shaped as the ego's is, by requests that name nobody.
        `cell`: egos whose links are one medium."""
        clock = clock or Clock()
        self._driver = driver
        self._wishes = wishes
        self._loop = loop
        self._flows = flows
        self._metrics = metrics
        self._log = log
        self._clock = clock
        self._notes = Notes(journal, metrics, log, clock)
        self._enforcer = Enforcer(driver, self._link_event)
        self._observer = Observer(metrics)
        self._queues = QueueWatch(log)
        self._ego = ego
        self._cell = Cell(cell)
        self._targets = Targets(wishes, loop, clock, self._cell)
        self._operators = Operators(
            driver,
            wishes,
            self._targets,
            self._enforcer,
            flows,
            metrics,
            self._notes,
            clock,
            ego=ego,
            others=others,
            on_unshaped=self._unshaped,
        )
        self._robots: Mapping[str, str] = {}
        self._lock = threading.RLock()
        self._wake = threading.Event()
        self._unready = ""
        self._lacking: tuple[str, ...] = ()
        self._unlent = ""
        """Why links of the cell have their parts of it and no more."""
        self._adopted = False
        self._closed = False
        self._looks = 0
        self._lost: list[str] = []
        self._heard: deque[tuple[NetDemand, float]] = deque(maxlen=MAX_HEARD)
        """Demands since the last look; Zenoh's threads fill it and must not wait for the lock."""
        self.on_lost: Callable[[str], None] = lambda robot: None
        """Hears of robots on whose links nothing can be promised any more."""

    @_locked
    def start(self) -> None:
        """Takes over the links that an earlier controller shaped and that are still wanted, and
        clears the others. A kernel that cannot shape is told of, and asked again later; what was
        there is taken over then."""
        self._look_around()
        if not self._unready:
            self._enforcer.reconcile(self._targets.shapes())

    def run(
        self,
        stop: threading.Event,
        publish: Callable[[tuple[LinkState, ...]], None],
        turned: Turned = nobody,
    ) -> None:
        """Follows profiles and measures until `stop` is set; `publish` gets the states, 1 Hz and
        at once when a link has another shape."""
        state_due = time.monotonic()
        self._queues.start()
        told = self._enforcer.changes
        while not stop.is_set():
            turned()
            self._wake.clear()
            due_s = RETRY_S
            try:
                self.follow()
                late_s = time.monotonic() - state_due
                if late_s >= 0.0:
                    state_due += (1 + int(late_s / STATE_S)) * STATE_S
                    told = self._enforcer.changes
                    publish(self.observe())
                elif told != self._enforcer.changes:
                    told = self._enforcer.changes
                    publish(self.observe(between=True))
                self._tell_lost()
                due_s = self._next_change_s()
            except NetworkError as error:
                self._log.error("step_failed", error=str(error))
            except Exception:
                # One broken step must not leave links without anybody who follows their profile.
                self._log.error("step_failed", exc_info=True)
            self._wake.wait(max(MIN_WAIT_S, min(state_due - time.monotonic(), due_s)))
        self._queues.close()

    def wake(self) -> None:
        """Has `run` look again at once: at what has changed, or whether it should stop."""
        self._wake.set()

    @_locked
    def follow(self) -> None:
        """Ends what has expired, and brings links to what is wanted now."""
        if self._closed:
            return
        expired = self._wishes.expire(self._clock.now_ns())
        if not self._unready:
            self._enforcer.reconcile(self._targets.shapes())
        for wish in expired:
            why = f"the shape of {wish.operator} has ended"
            self._notes.note("expired", why, wish.link)
            if self._wishes.get(wish.link) is None:
                self._unshaped(wish.link)
        if expired:
            self._wishes.changed()

    @_locked
    def observe(self, *, between: bool = False) -> tuple[LinkState, ...]:
        """Reads all counters, takes the slow loop's steps, and returns the links' states; see
        `Observer.look` for `between`."""
        if self._closed:
            return ()
        self._look_around()
        self._looks += 1
        self._notes.retry()
        if self._looks % RENEW_LOOKS == 0:
            self._enforcer.renew()
        now_s = time.monotonic()
        readings = self._driver.read(self._enforcer.links())
        self._enforcer.check(readings, self._robots)
        shaped = self._enforcer.links()
        self._queues.watch({k: found.queue for k, found in readings.items() if k in shaped})
        backlogs = {link: self._queues.read(link) for link in readings}
        classes = self._observer.look(readings, backlogs, now_s, between=between)
        loads = {link: self._observer.load(link, reading) for link, reading in readings.items()}
        # Of the shapes that were read: a step of this look shows in the next one's.
        levels = {link: self._targets.level(link) for link in readings}
        while self._heard:
            self._loop.on_demand(*self._heard.popleft())
        for action in self._loop.tick({k: v for k, v in loads.items() if k in shaped}, now_s):
            self._take(action)
        demands = self._loop.demands(now_s)
        self._metrics.show_demands(
            {ego: (d.needed_bytes_s, d.unreachable_s) for ego, d in demands.items()}
        )
        needs = {ego: 8.0 * demand.needed_bytes_s for ego, demand in demands.items()}
        rates_bps = self._targets.cell_rates_bps()
        busy = {
            link.robot
            for link, found in readings.items()
            if link.direction == "down" and self._observer.busy(link, found)
        }
        changed = [self._cell.divide(rates_bps, needs), self._cell.use(busy)]
        if any(changed):
            self._wake.set()
        states = tuple(
            link_state(
                link,
                reading,
                classes[link],
                loads[link],
                levels[link],
                # A link downwards is its own ego's; what comes from a robot may be for every ego.
                dict.fromkeys(demands, math.inf) if link.direction == "up" else {},
            )
            for link, reading in sorted(readings.items())
        )
        if grants := self._cell.grants(rates_bps):
            states = tuple(
                msgspec.structs.replace(state, grants=grants)
                if state.direction == "down" and state.robot in grants
                else state
                for state in states
            )
        self._metrics.show(states)
        return states

    def robots(self) -> tuple[str, ...]:
        """Whose links are on this host, as last found, sorted; none once it has ended."""
        return () if self._closed else tuple(sorted(self._robots))

    @_locked
    def troubles(self) -> tuple[str, ...]:
        """Why links cannot be shaped here, or are not as they should be."""
        problems = (f"{link}: {why}" for link, why in sorted(self._enforcer.problems.items()))
        return (*((self._unready,) if self._unready else self._lacking), *problems)

    def on_demand(self, demand: NetDemand) -> None:
        """Takes an ego's demand; never waits, so it may be called on Zenoh's threads."""
        self._heard.append((demand, time.monotonic()))

    @_locked
    def request(self, request: ShapeRequest) -> ShapeReply:
        """Carries out an operator's request, all of it or nothing.

        Raises NetworkError that says why not.
        """
        self._refuse_when_closed()
        if request.profile != "show" and self._unready:
            raise NetworkError(self._unready)
        reply = self._operators.carry_out(request)
        self._wake.set()
        notes = (*reply.notes, *(why for why in (self._unready, self._unlent) if why))
        return msgspec.structs.replace(reply, notes=notes)

    @_locked
    def robot_at(self, ipv4: str) -> str | None:
        """Whose link has this address, or None. Raises NetworkError."""
        robots = self._driver.robots()
        return next((robot for robot, address in robots.items() if address == ipv4), None)

    @_locked
    def capacity_bps(self, robot: str) -> int | None:
        """Capacity of a robot's link downwards; None where it is not shaped."""
        shape = self._enforcer.shape_of(Link(robot, "down"))
        return None if shape is None else shape.capacity_bps

    @_locked
    def hold(self, session_id: str, robot: str, level: int) -> None:
        """Keeps a robot's link at a level or above, until `release`. Raises NetworkError."""
        self._refuse_when_closed()
        link = Link(robot, "down")
        before = self._targets.held(session_id)
        if link not in self._enforcer.links():
            raise NetworkError(f"the link towards {robot} is not shaped: nothing can be promised")
        try:
            self._targets.hold(session_id, (link, level))
            self._enforcer.change({link: self._targets.shapes()[link]})
        except Exception:
            self._metrics.failures.inc()
            self._targets.hold(session_id, before)
            raise
        why = f"Quality-on-Demand session {session_id}"
        self._notes.note("held", why, link, level=self._targets.level(link))

    @_locked
    def release(self, session_id: str) -> None:
        """Ends a hold. The link falls to the level that others still need."""
        held = self._targets.held(session_id)
        if held is None or self._closed:
            return
        link, _ = held
        self._targets.hold(session_id, None)
        self._enforcer.reconcile(self._targets.shapes())
        why = f"Quality-on-Demand session {session_id}"
        self._notes.note("released", why, link, level=self._targets.level(link))

    @_locked
    def close(self) -> None:
        """Ends telemetry flows and makes all links unshaped; the wishes are kept for the next
        start. Only a controller that is killed leaves shapes behind, which `start` finds."""
        self._closed = True
        self._flows.close()
        self._enforcer.reconcile({})
        self._driver.close()

    def _take(self, action: Action) -> None:
        """One step of the slow loop, if the kernel takes it."""
        before = self._targets.level(action.link)
        self._loop.done(action)
        level = self._targets.level(action.link)
        try:
            self._enforcer.change({action.link: self._targets.shapes().get(action.link)})
        except NetworkError as error:
            self._metrics.failures.inc()
            self._loop.levels[action.link] = action.before
            self._notes.note("step_failed", str(error), action.link, level=before)
            return
        name = "raised" if action.after > action.before else "lowered"
        self._notes.note(name, action.reason, action.link, level=level, before=before)

    def _look_around(self) -> None:
        """Which robots are here, and whether links can be shaped at all."""
        try:
            self._robots = self._driver.robots()
            if self._unready or not self._enforcer.links():
                found = self._driver.capabilities()
                self._lacking = lacking(found)
                if self._cell.egos:
                    self._share(lacking_tree(found))
        except NetworkError as error:
            if str(error) != self._unready:
                self._notes.note("unready", str(error))
            self._unready = str(error)
            return
        if self._unready:
            self._notes.note("ready", "links can be shaped again")
        self._unready = ""
        if not self._adopted:
            self._adopt()

    def _share(self, missing: str) -> None:
        """Lets links of the cell lend each other what they leave unused, if nothing is missing."""
        if not self._driver.one_tree:
            missing = f"driver {self._driver.name} shapes each link by itself"
        self._cell.lends = not missing
        why = f"egos of the cell lend each other nothing: {missing}" if missing else ""
        if why and why != self._unlent:
            self._notes.note("lends_nothing", why)
        self._unlent = why

    def _adopt(self) -> None:
        """Takes over what an earlier controller shaped, at the level that it had reached."""
        wanted = self._targets.shapes()
        found = self._driver.shaped()
        for link, reading in self._driver.read(found).items():
            classes = {t: one.shape for t, one in reading.classes.items()}
            level = ladder.level_of(reading.capacity_bps, classes)
            if link in wanted and level is not None:
                self._loop.levels[link] = level
                self._notes.note("adopted", "an earlier controller shaped it", link, level=level)
        for link in found - set(wanted):
            self._notes.note("cleared", "an earlier controller left it; nobody wants it", link)
        self._enforcer.adopt(found)
        self._adopted = True

    def _refuse_when_closed(self) -> None:
        if self._closed:
            raise NetworkError("the controller is ending; ask the next one")

    def _next_change_s(self) -> float:
        with self._lock:
            troubled = self._enforcer.problems or self._unready
            return min(RETRY_S if troubled else math.inf, self._targets.next_change_s())

    def _link_event(self, action: str, reason: str, link: Link) -> None:
        self._notes.note(action, reason, link)
        if action == "link_gone":
            self._unshaped(link)

    def _unshaped(self, link: Link) -> None:
        """A link has no shape any more: it starts at level 0 when it gets one again."""
        self._loop.forget(link)
        if link.direction == "down":
            self._lost.append(link.robot)

    def _tell_lost(self) -> None:
        """Outside the lock: who hears of it may call back."""
        with self._lock:
            lost, self._lost = self._lost, []
        for robot in lost:
            self.on_lost(robot)
