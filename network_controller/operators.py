"""Carrying out what operators ask for: all of it or nothing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress

from network_controller.drivers.base import Driver
from network_controller.enforce import Enforcer
from network_controller.metrics import ControllerMetrics
from network_controller.model import DIRECTIONS, Link
from network_controller.notes import Notes
from network_controller.requests import CONGEST_S, UTILISATION, links_of, wish_of
from network_controller.targets import Targets
from network_controller.telemetry.flows import Flows
from network_controller.wishes import Wishes
from swarm.errors import NetworkError
from swarm.messages import ShapeInForce, ShapeReply, ShapeRequest
from swarm.process import Clock


class Operators:
    """The net/shape half of the controller. Used under its lock."""

    def __init__(
        self,
        driver: Driver,
        wishes: Wishes,
        targets: Targets,
        enforcer: Enforcer,
        flows: Flows,
        metrics: ControllerMetrics,
        notes: Notes,
        clock: Clock,
        *,
        ego: str,
        others: Sequence[str],
        on_unshaped: Callable[[Link], None],
    ) -> None:
        """`on_unshaped(link)` hears of links that have no shape any more."""
        self._driver = driver
        self._wishes = wishes
        self._targets = targets
        self._enforcer = enforcer
        self._flows = flows
        self._metrics = metrics
        self._notes = notes
        self._clock = clock
        self._ego = ego
        self._others = others
        self._on_unshaped = on_unshaped

    def carry_out(self, request: ShapeRequest) -> ShapeReply:
        """Does what is asked. Raises NetworkError that says why not; nothing has changed then."""
        try:
            notes = self._carry_out(request)
        except NetworkError as error:
            self._metrics.requests.labels(request.profile, "refused").inc()
            if request.profile != "show":
                self._notes.note(
                    "refused",
                    str(error),
                    operator=request.operator,
                    profile=request.profile,
                    robot=request.robot or self._ego,
                )
            raise
        self._metrics.requests.labels(request.profile, "done").inc()
        problems = (f"{link}: {why}" for link, why in sorted(self._enforcer.problems.items()))
        return ShapeReply(
            request=request.request,
            revision=self._wishes.revision,
            shapes=self._in_force(),
            congested=tuple(sorted(self._flows.running())),
            notes=(*notes, *problems),
        )

    def _carry_out(self, request: ShapeRequest) -> tuple[str, ...]:
        if request.profile == "show":
            return ()
        if request.revision is not None and request.revision != self._wishes.revision:
            raise NetworkError(
                f"the shapes have revision {self._wishes.revision}, not {request.revision}: "
                "somebody else has changed them; look at them again first"
            )
        if request.profile == "congest":
            return self._congest(request)
        if request.profile == "relieve":
            return self._relieve(request)
        if request.profile == "off":
            return self._off(request)
        return self._shape(request)

    def _shape(self, request: ShapeRequest) -> tuple[str, ...]:
        links = self._links(request)
        replaced = tuple(
            f"{link}: this replaces the shape of {old.operator}"
            for link in links
            if (old := self._wishes.get(link)) is not None
            and old.layer != "start"
            and old.operator != request.operator
        )
        now_ns = self._clock.now_ns()
        wishes = [wish_of(request, link, now_ns) for link in links]

        def put() -> None:
            for wish in wishes:
                self._wishes.put(wish)

        self._change(links, put)
        for wish in wishes:
            self._notes.note(
                "shaped",
                f"asked for by {wish.operator}",
                wish.link,
                profile=wish.kind,
                rate_bps=wish.rate_bps(now_ns),
                until_ns=wish.until_ns,
            )
        return replaced

    def _off(self, request: ShapeRequest) -> tuple[str, ...]:
        """Without a robot it ends what operators have made of all links in the direction; where
        that is downwards, telemetry too."""
        meant = DIRECTIONS if request.direction == "both" else (request.direction,)
        wished = self._wishes.copy()
        # Also of a robot that has left: its shape would be waiting for its return.
        if request.robot and request.robot not in {link.robot for link in wished}:
            self._links(request)
        links = tuple(
            link
            for link in wished
            if link.direction in meant
            and request.robot in ("", link.robot)
            and set(wished[link]) != {"start"}
        )

        def drop() -> None:
            for link in links:
                self._wishes.drop(link)

        # The links of robots that have left are not there to be changed.
        present = self._driver.robots()
        self._change(tuple(link for link in links if link.robot in present), drop)
        if "down" in meant:
            self._flows.stop(request.robot or None)
        for link in links:
            if self._wishes.get(link) is None:
                self._on_unshaped(link)
            why = f"asked for by {request.operator or 'unknown'}"
            self._notes.note("shape_ended", why, link)
        return ()

    def _change(self, links: tuple[Link, ...], edit: Callable[[], None]) -> None:
        """Edits the wishes, applies and keeps them. Raises NetworkError; all is as before then."""
        before = self._wishes.copy()
        applied = {link: self._enforcer.shape_of(link) for link in links}
        try:
            edit()
            wanted = self._targets.shapes()
            self._enforcer.change({link: wanted.get(link) for link in links})
            self._wishes.changed()
        except Exception:
            self._metrics.failures.inc()
            self._wishes.restore(before)
            # What cannot be undone now is a difference, which the next look finds.
            with suppress(NetworkError):
                self._enforcer.change(applied)
            raise

    def _congest(self, request: ShapeRequest) -> tuple[str, ...]:
        robot = self._links(request)[0].robot
        link = Link(robot, "down")
        shape = self._enforcer.shape_of(link)
        rate_bps = request.rate_bps
        if rate_bps is None:
            if shape is None:
                raise NetworkError(
                    f"the link towards {robot} is not shaped, so it has no {UTILISATION:.0%}; name "
                    "a rate, or shape the link first"
                )
            rate_bps = round(UTILISATION * shape.capacity_bps)
        seconds = request.duration_s or CONGEST_S
        self._flows.start(robot, rate_bps, seconds, request.protocol)
        why = f"asked for by {request.operator or 'unknown'}"
        self._notes.note("congested", why, link, rate_bps=rate_bps, seconds=seconds)
        return (f"{rate_bps / 1e6:.2f} Mbit/s of telemetry towards {robot} for {seconds:g} s",)

    def _relieve(self, request: ShapeRequest) -> tuple[str, ...]:
        running = self._flows.running()
        if request.robot and request.robot not in running:
            self._links(request)
        ended = sorted(robot for robot in running if request.robot in ("", robot))
        for robot in ended:
            self._flows.stop(robot)
            why = f"asked for by {request.operator or 'unknown'}"
            self._notes.note("relieved", why, Link(robot, "down"))
        return () if ended else ("no telemetry was running there",)

    def _links(self, request: ShapeRequest) -> tuple[Link, ...]:
        return links_of(request, self._ego, frozenset(self._driver.robots()), self._others)

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
