"""What the swarm's messages say, put on the board with the time at which they came."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Collection, Mapping
from time import monotonic
from typing import Any

from options.console.board import FAULTS, HISTORY, Board, now_s
from options.console.faults import SILENT_S, Faults
from options.console.figures import Tally, link_figures
from swarm.arrays import unpack_finite
from swarm.controllers import Controllers
from swarm.errors import MessageError
from swarm.messages import (
    Beacon,
    Decision,
    Detections,
    GatewayState,
    NetDemand,
    NetState,
    RobotSteered,
    SceneDescription,
    ShapeRequest,
    Tracks,
)

MAX_ROBOTS = 1024
"""More than a swarm has; ids come from the network."""
MAX_OBJECTS, MAX_BOXES = 256, 512
"""Drawn of one message; the first ones."""
TRAFFIC_S = 1.0
_NO_WORD: dict[str, Any] = {"off_duty_by": "", "answers": None}
"""Of a robot that nobody has asked."""


class View:
    """One swarm as one ego sees it. Zenoh's threads call `on_...`, one other the rest.

    What is shown carries times of this host's clock; how long ago something was is counted on the
    steady one, which nobody sets.
    """

    def __init__(self, board: Board, swarm: str, ego: str, comm_range_m: float) -> None:
        self._board = board
        self._lock = threading.Lock()
        self._faults = Faults(ego, lambda fault: board.append(FAULTS, {"at": now_s(), **fault}))
        self._robots: dict[str, dict[str, Any]] = {}
        self._swarm: dict[str, Any] = {
            "swarm": swarm,
            "ego": ego,
            "comm_range_m": comm_range_m,
            "connected": False,
            "since": now_s(),
            "gateway": None,
        }
        self._controllers = Controllers()
        self._heard_at: dict[str, float] = {}
        """When each robot joined or sent its last beacon."""
        self._sizes: dict[str, dict[str, int]] = {}
        """Bytes that a frame of each robot takes, by algorithm, as it announces them."""
        self._tally, self._traffic = Tally(0.0), Tally(0.0)
        self._looking_at: float | None = None
        """Since when robots are listened to."""
        self.decided_at: float | None = None
        """When the newest decision came, seconds on the steady clock."""
        board.put("swarm", self._swarm)

    @property
    def ego(self) -> str:
        """The ego that decides: the configured one, or the one that stands in for it."""
        return str(self._swarm["ego"])

    @property
    def connected(self) -> bool:
        """Whether the router is reached."""
        return bool(self._swarm["connected"])

    def robots(self) -> Collection[str]:
        """Those that were heard of and are not forgotten."""
        with self._lock:
            return tuple(self._robots)

    def tick(self, connected: bool) -> None:
        """Once a second or so: rates, and what is missing. `connected`: the router is reached."""
        now = monotonic()
        with self._lock:
            if connected != self._swarm["connected"]:
                self._tell(connected=connected, since=now_s())
            if now - self._traffic.since >= TRAFFIC_S:
                if self._traffic.frames:
                    self._board.put("traffic", {"at": now_s(), **self._traffic.rates(now)})
                self._traffic = Tally(now)
            self._faults.tick(now, connected, self._heard())

    def on_join(self, robot: str) -> None:
        """A robot's liveliness token is there."""
        self._alive(robot, True)

    def on_leave(self, robot: str) -> None:
        """It is gone."""
        self._alive(robot, False)

    def on_duty(self, reply: RobotSteered) -> None:
        """Why a robot is not there: an operator took it off duty."""
        if reply.on_duty:
            return
        with self._lock:
            known = self._robots.get(reply.robot)
            if known is not None and not known["alive"]:
                self._robot(reply.robot, off_duty_by=reply.operator or "an operator")
                self._faults.off_duty(reply.robot, reply.operator)

    def silent(self) -> list[str]:
        """Robots that are alive but not heard, and of which nobody knows whether they answer."""
        with self._lock:
            return [r for r in self._silent_now() if self._robots[r]["answers"] is None]

    def on_answer(self, robot: str, answers: bool) -> None:
        """Whether a robot that is not heard answers all the same, or stands still."""
        with self._lock:
            known = self._robots.get(robot)
            if known is not None and known["alive"] and robot in self._silent_now():
                self._robot(robot, answers=answers)
                if not answers:
                    self._faults.stalled(robot)

    def on_gateway(self, alive: bool) -> None:
        """The LLM gateway's token has come or gone."""
        with self._lock:
            self._tell(gateway={"alive": alive, "since": now_s()})
            self._faults.gateway(alive)

    def on_gateway_state(self, state: GatewayState) -> None:
        """How the gateway stands with its model."""
        with self._lock:
            self._faults.gateway_state(state)

    def on_beacon(self, beacon: Beacon) -> None:
        """Where a robot is."""
        x, y, _z, _roll, _pitch, yaw = beacon.pose
        vx, vy, _vz = beacon.velocity
        facts = {
            "at": now_s(),
            "x": round(x, 2),
            "y": round(y, 2),
            "yaw": round(yaw, 3),
            "speed": round((vx * vx + vy * vy) ** 0.5, 2),
            "range_m": beacon.range_m,
            "answers": None,
        }
        with self._lock:
            if self._robot(beacon.robot, **facts):
                self._heard_at[beacon.robot] = monotonic()
                self._faults.beacon(beacon.robot)
                # Apart from what changes with every beacon; on a narrow link many tell no sizes.
                if beacon.sizes and self._sizes.get(beacon.robot) != beacon.sizes:
                    self._sizes[beacon.robot] = beacon.sizes
                    self._board.put(f"sizes/{beacon.robot}", beacon.sizes)

    def on_scene(self, scene: SceneDescription) -> None:
        """What a robot sees."""
        try:
            objects = unpack_finite(scene.objects, "objects", 9)[:MAX_OBJECTS]
            visible = unpack_finite(scene.visible_m, "visible_m", 1)[:360, 0]
        except MessageError as error:
            with self._lock:
                if self._known(scene.robot):
                    self._faults.unreadable(scene.robot, str(error))
            return
        value = {
            "at": now_s(),
            "x": round(scene.pose[0], 2),
            "y": round(scene.pose[1], 2),
            # Centre and size in the ground plane.
            "objects": [[round(float(v), 2) for v in row] for row in objects[:, [0, 1, 4, 5]]],
            "visible_m": [round(float(v), 1) for v in visible],
        }
        with self._lock:
            if self._known(scene.robot):
                self._board.put(f"scene/{scene.robot}", value)

    def on_detections(self, detections: Detections) -> None:
        """What the ego and its participants see together."""
        try:
            boxes = unpack_finite(detections.boxes, "boxes", 7)[:MAX_BOXES]
            scores = unpack_finite(detections.scores, "scores", 1)[:MAX_BOXES, 0]
            remembered = _remembered(detections.tracks)
        except MessageError as error:
            with self._lock:
                if self._known(detections.ego):
                    self._faults.unreadable(detections.ego, str(error))
            return
        value = {
            # When what is drawn was sensed.
            "at": now_s() - (detections.age_ms or 0.0) * 1e-3,
            "algorithm": detections.algorithm,
            "participants": detections.participants,
            "missing": detections.missing,
            "latency_ms": round(detections.latency_ms, 1),
            "operating_point": detections.operating_point,
            # x, y, length, width, heading, score.
            "boxes": [
                [round(float(row[i]), 2) for i in (0, 1, 3, 4, 6)] + [round(float(score), 2)]
                for row, score in zip(boxes, scores, strict=False)
            ],
            # The same of what nobody sees in this frame, and for how long nobody has, seconds.
            "remembered": remembered,
            # Robot, x, y, length, width, heading, and why it may stand elsewhere.
            "known": [
                [one.robot]
                + [round(v, 2) for v in (*one.center[:2], *one.size[:2], one.heading)]
                + [one.doubt]
                for one in detections.known[:MAX_ROBOTS]
            ],
        }
        with self._lock:
            self._tally.add(detections)
            self._traffic.add(detections)
            self._board.put("detections", value)

    def on_decision(self, decision: Decision) -> None:
        """Who takes part, how and why."""
        advice = decision.advice
        value = {
            "at": now_s(),
            "decided": decision.decided_ns / 1e9,
            "cycle": decision.cycle,
            "participants": decision.participants,
            "algorithm": decision.algorithm,
            "reason": decision.reason,
            "source": decision.source,
            "policy": decision.policy,
            "model": decision.model,
            "valid": decision.valid,
            "repairs": decision.repairs,
            "quality": round(decision.quality, 4),
            "cost_bps": round(8 * decision.cost_bytes * decision.rate_hz),
            "capacity_bps": round(decision.capacity_bps),
            "advice": None if advice is None else [advice.state, advice.refusal],
            "blind": decision.blind,
            "excluded": decision.excluded,
            "silent": decision.silent,
            "doubted": decision.doubted,
            "remarks": decision.remarks,
            "ages_s": decision.ages_s,
            "rate_hz": decision.rate_hz,
            # Robot, algorithm, contributions a second, answers about places, whether of objects.
            "assignments": [
                [
                    one.robot,
                    one.algorithm,
                    round(one.rate_hz, 2),
                    round(one.places_hz, 2),
                    one.objects_only,
                ]
                for one in decision.assignments
            ],
            "intents": [
                {
                    "number": one.number,
                    "operator": one.operator,
                    "since": one.since_ns / 1e9,
                    "until": one.until,
                    "says": one.says,
                    "bound": one.bound,
                }
                for one in decision.intents
            ],
            "arrival": {robot: round(share, 2) for robot, share in decision.arrival.items()},
        }
        now = monotonic()
        with self._lock:
            self.decided_at = now
            if decision.ego != self._swarm["ego"]:
                self._tell(ego=decision.ego)
            self._board.put("decision", value)
            shared = ("at", "cycle", "participants", "algorithm", "source", "valid")
            past = {name: value[name] for name in (*shared, "capacity_bps", "cost_bps")}
            # How many send each form.
            past["forms"] = dict(Counter(one.algorithm for one in decision.assignments))
            self._board.append(HISTORY, past | self._tally.figures(now))
            self._tally = Tally(now)
            self._faults.decision(now, decision)

    def on_demand(self, demand: NetDemand) -> None:
        """What the ego needs of its cell."""
        if demand.ego != self._swarm["ego"]:
            return
        value = {
            "at": now_s(),
            "needed_bps": 8 * demand.needed_bytes_s,
            "possible": demand.possible,
            "reachable": demand.reachable,
            "burst_bytes": demand.burst_bytes,
            "q_min": demand.q_min,
        }
        with self._lock:
            self._board.put("demand", value)
            self._faults.demand(demand)

    def on_net_state(self, state: NetState) -> None:
        """What links carry."""
        now = monotonic()
        with self._lock:
            self._controllers.take(state, now)
            links = [link_figures(link) for link in self._controllers.links(now)]
            unshaped = self._controllers.unshaped(now)
            self._board.put("net", {"at": now_s(), "links": links, "unshaped": unshaped})
            self._faults.net_state(now)

    def addressees(self, request: ShapeRequest) -> Mapping[str, ShapeRequest]:
        """Which network controllers a request goes to; see `Controllers.addressees`."""
        with self._lock:
            return self._controllers.addressees(request, self.ego, monotonic())

    def sees(self) -> None:
        """Robots are listened to from now on."""
        with self._lock:
            now = self._looking_at = monotonic()
            self._tally, self._traffic = Tally(now), Tally(now)

    def blind(self) -> None:
        """Nobody listens to robots any more: what they said is taken down rather than left to
        age."""
        now = monotonic()
        with self._lock:
            for robot, facts in self._robots.items():
                self._board.put(f"scene/{robot}", None)
                kept = {name: facts[name] for name in ("robot", "alive", "since", *_NO_WORD)}
                self._robots[robot] = kept
                self._board.put(f"robot/{robot}", kept)
            self._board.put("detections", None)
            self._board.put("traffic", None)
            self._tally, self._traffic = Tally(now), Tally(now)
            self._looking_at = None

    def _silent_now(self) -> set[str]:
        now = monotonic()
        return {robot for robot, at in self._heard().items() if now - at > SILENT_S}

    def _heard(self) -> dict[str, float]:
        """When each living robot was heard last, or could have been for the first time."""
        if self._looking_at is None:
            return {}
        return {
            robot: max(self._heard_at[robot], self._looking_at)
            for robot, facts in self._robots.items()
            if facts["alive"]
        }

    def _alive(self, robot: str, alive: bool) -> None:
        now = monotonic()
        with self._lock:
            if self._robot(robot, alive=alive, since=now_s(), off_duty_by="", answers=None):
                self._heard_at[robot] = now
                self._faults.alive(now, robot, alive)

    def _robot(self, robot: str, **facts: Any) -> bool:
        """Adds to what is known of a robot; False where there are too many already."""
        known = self._robots.get(robot)
        if known is None:
            if len(self._robots) >= MAX_ROBOTS and not (facts.get("alive") and self._forget_one()):
                return False
            # One of which only beacons came is not known to be alive.
            known = {"robot": robot, "alive": False, "since": None, **_NO_WORD}
        # A new one each time: the old one may be about to be encoded.
        self._robots[robot] = known | facts
        self._board.put(f"robot/{robot}", self._robots[robot])
        return True

    def _forget_one(self) -> bool:
        """Makes room by the robot that has been away longest; False where all are there."""
        away = [facts for facts in self._robots.values() if not facts["alive"]]
        if not away:
            return False
        robot = min(away, key=lambda facts: facts["since"] or 0.0)["robot"]
        del self._robots[robot]
        self._heard_at.pop(robot, None)
        self._faults.forget(robot)
        self._sizes.pop(robot, None)
        for kind in ("scene", "sizes", "robot"):
            self._board.put(f"{kind}/{robot}", None)
        return True

    def _known(self, robot: str) -> bool:
        return robot in self._robots or self._robot(robot)

    def _tell(self, **facts: Any) -> None:
        self._swarm = self._swarm | facts
        self._board.put("swarm", self._swarm)


def _remembered(tracks: Tracks | None) -> list[list[float]]:
    """x, y, length, width, heading, score and age of what was not seen in a frame. Raises
    MessageError for tables that do not fit each other."""
    if tracks is None:
        return []
    boxes = unpack_finite(tracks.boxes, "boxes", 7)[:MAX_BOXES]
    scores = unpack_finite(tracks.scores, "scores", 1)[:MAX_BOXES, 0]
    ages_s = unpack_finite(tracks.ages_s, "ages_s", 1)[:MAX_BOXES, 0]
    return [
        [round(float(row[i]), 2) for i in (0, 1, 3, 4, 6)]
        + [round(float(score), 2), round(float(age_s), 1)]
        for row, score, age_s in zip(boxes, scores, ages_s, strict=False)
        if age_s > 0.0
    ]
