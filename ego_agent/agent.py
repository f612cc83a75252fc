"""The control cycle: Monitor, Analyze, Plan, Execute, at a steady period, whatever happens.

The cycle never waits for the network: it reads what has arrived, computes, publishes. A router that
is away, an own scan that cannot be read, a policy that fails: each costs what it costs, and the
next decision comes in time all the same.
"""

from __future__ import annotations

import threading
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import msgspec

from ego_agent.analyze.doubts import doubted
from ego_agent.analyze.fit import remarks, told
from ego_agent.analyze.scene import analyze
from ego_agent.execute.fusion_loop import FusionLoop
from ego_agent.execute.sense import OwnSensor
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.journal import CycleRecord, Journal
from ego_agent.knowledge.model import Snapshot, UnifiedScene
from ego_agent.knowledge.record import cycle_record, cycle_result
from ego_agent.knowledge.tally import TallyKeeper
from ego_agent.knowledge.weighed import Weighed
from ego_agent.metrics import EgoMetrics
from ego_agent.monitor.leading import Alone, Lead
from ego_agent.monitor.own_duty import OwnDuty
from ego_agent.monitor.snapshot import Monitor
from ego_agent.plan.arrivals import Arrivals, bounded
from ego_agent.plan.choices.options import Compared, compare
from ego_agent.plan.choices.scoring import Scorer
from ego_agent.plan.choices.weigh import weigh
from ego_agent.plan.control_budget import ControlBudget, Wish, beacons_stand
from ego_agent.plan.decision import alone
from ego_agent.plan.demand import DemandMeter
from ego_agent.plan.intents.bind import bound_scene, known_objects
from ego_agent.plan.intents.combine import Standing
from ego_agent.plan.intents.obey import plan_obeying
from ego_agent.plan.intents.told import told as told_intents
from ego_agent.plan.probe import Prober
from ego_agent.plan.unheard import UnheardProber
from ego_agent.steering import Steering
from swarm import keyspace
from swarm.body import Body
from swarm.errors import JournalError, TransportError
from swarm.log import Logger
from swarm.loop_watch import Loops, unwatched
from swarm.messages import Decision, NetDemand, Probe
from swarm.process import Clock
from swarm.session import Session
from swarm.version import installed_version

LOOK_S = 0.1
"""How often an ego that stands by looks whether it is to lead."""
FOLLOW_S = 1.0
"""And how often it looks at the swarm meanwhile."""


@dataclass(frozen=True, slots=True)
class _Running:
    """A cycle whose decision is in force and whose journal line is not written yet."""

    snapshot: Snapshot
    scene: UnifiedScene | None
    decision: Decision
    published: bool
    cycle_ms: float
    demand: NetDemand | None
    weighed: Weighed | None


class EgoAgent:
    """One ego: its parts, and the loop that drives them; `ego_agent.wiring.ego_of` makes one."""

    def __init__(
        self,
        *,
        monitor: Monitor,
        knowledge: Knowledge,
        steering: Steering,
        sensor: OwnSensor,
        fusion: FusionLoop,
        tally: TallyKeeper,
        journal: Journal | None,
        metrics: EgoMetrics,
        clock: Clock,
        log: Logger,
        usual_body: Body,
        lead: Lead | None = None,
        stands_in_for: str | None = None,
    ) -> None:
        """`usual_body`: of robots that announce none. `lead`: None for an ego without another."""
        self._lead = lead or Alone()
        self._stands_in_for = stands_in_for
        self._follow_due = 0.0
        self.monitor = monitor
        self.knowledge = knowledge
        self._steering = steering
        self.sensor = sensor
        self.fusion = fusion
        self.tally = tally
        self._journal = journal
        self._metrics = metrics
        self._clock = clock
        self._log = log
        self._usual_body = usual_body
        self._session: Session | None = None
        self._ego = monitor.ego
        self._demand = DemandMeter()
        self._prober = Prober()
        self._unheard = UnheardProber()
        self._probe: Probe | None = None
        """Of the next decision."""
        self._arrivals = Arrivals()
        self._control = ControlBudget()
        self._own_duty = OwnDuty(monitor.ego, monitor.note_own_duty)
        self._ignored: dict[str, int] = defaultdict(int)
        self._detections_lost = 0

    def run(
        self,
        period_s: float,
        stop: threading.Event,
        connect: Callable[[], Session | None],
        loops: Loops = unwatched,
    ) -> None:
        """Runs cycles until `stop` is set; `connect` runs beside them until the router is there."""
        connector = threading.Thread(target=self._connect, args=(connect,), daemon=True)
        connector.start()
        number = self._journal.next_cycle if self._journal else 1
        previous: Decision | None = None
        self.fusion.start(loops)
        turned = loops("cycle", period_s)
        due = time.monotonic()
        stopping = False
        # A stop that comes while a line is written ends the cycle after it, whose line holds the
        # frames since.
        while not stopping:
            turned()
            if not self._lead.look():
                self._stand_by(number)
                previous, due = None, time.monotonic()
                stopping = stop.wait(LOOK_S)
                if stopping:
                    self.fusion.stop()
                continue
            running = self._begin(number, previous)
            previous = running.decision
            number += 1
            due += period_s
            late = int(max(0.0, time.monotonic() - due) / period_s)
            if late:
                self._metrics.cycles_missed.inc(late)
                due += late * period_s
            stopping = stop.wait(max(0.0, due - time.monotonic()))
            if stopping:
                self.fusion.stop()  # the last line holds the last frame too
            try:
                self._complete(running)
            except Exception:
                self._metrics.cycle_faults.inc()
                self._log.error("cycle_not_recorded", exc_info=True)

    def close(self) -> None:
        """Closes journal and session, if there are any, and lets go of the policy."""
        self.monitor.close()
        if self._journal is not None:
            self._journal.close()
        if self._session is not None:
            self._session.close()
        self._steering.close()

    def _connect(self, connect: Callable[[], Session | None]) -> None:
        try:
            session = connect()
            if session is None:
                return
            self.monitor.attach(session)
            self._own_duty.attach(session)
            self._lead.attach(session)
            self.fusion.connect(session)
            self._session = session
            self._steering.attach(session)
            self._log.info("router_reached")
        except Exception:
            # Without a thread that tries again the ego stays alone: say so, loudly, and go on.
            self._log.error("connect_failed", exc_info=True)

    def _stand_by(self, number: int) -> None:
        """Another ego leads: this one decides nothing, and follows the swarm all the same."""
        self.fusion.follow(None)
        self._metrics.leads.set(False)
        now = time.monotonic()
        if now < self._follow_due:
            return
        self._follow_due = now + FOLLOW_S
        try:
            self.sensor.locate()
            self._own_duty.look(self._session)
            self._metrics.links(self.monitor.snapshot(number, self._clock.now_ns()))
        except Exception:
            self._metrics.cycle_faults.inc()
            self._log.error("stand_by_failed", exc_info=True)

    def _begin(self, number: int, previous: Decision | None) -> _Running:
        """One cycle up to its published decision."""
        begun = time.perf_counter()
        self.sensor.locate()
        self._own_duty.look(self._session)
        now_ns = self._clock.now_ns()
        snapshot = self.monitor.snapshot(number, now_ns)
        self.knowledge.experience.look(
            snapshot.capacity_bps if snapshot.capacity_is_configured else None,
            standing=beacons_stand(snapshot),
        )
        scene: UnifiedScene | None = None
        compared: list[Compared] = []
        policy, wishes = self._steering.take(self.knowledge)
        try:
            known = known_objects(self.fusion.remembered)
            self._steering.minute.note(snapshot, time.monotonic(), known)
            scene = bound_scene(analyze(snapshot, self.knowledge), wishes, known)
            decision = plan_obeying(
                snapshot,
                scene,
                policy,
                self.knowledge,
                previous,
                number,
                now_ns,
                wishes,
                on_compared=compared.append,
            )
            doubts = bounded(doubted(snapshot, self.knowledge.objective, self._usual_body))
            decision = msgspec.structs.replace(
                decision, probe=self._probe, doubted=doubts, remarks=remarks(snapshot)
            )
        except Exception as error:
            self._metrics.cycle_faults.inc()
            self._log.error("cycle_failed", cycle=number, exc_info=True)
            reason = f"the cycle failed: {type(error).__name__}"
            decision = alone(snapshot, self.knowledge, policy.name, reason)
        control = self._control.take(snapshot, time.monotonic())
        decision = self._told(decision, snapshot, scene, wishes)
        decision = msgspec.structs.replace(decision, stands_in_for=self._stands_in_for)
        self._lead.decided(decision.valid and scene is not None and scene.is_whole())
        self._metrics.leads.set(self._lead.speaks())
        self.fusion.follow(decision)
        published = self._publish(keyspace.decision, decision)
        cycle_ms = (time.perf_counter() - begun) * 1e3
        demand = self._say_demand(snapshot, scene, decision, control)
        weighed = self._weighed(scene, decision, compared)
        self._probe = self._next_probe(snapshot, scene, decision, wishes)
        self._metrics.links(snapshot)
        self._metrics.decided(decision, scene)
        return _Running(snapshot, scene, decision, published, cycle_ms, demand, weighed)

    def _told(
        self, decision: Decision, snapshot: Snapshot, scene: UnifiedScene | None, wishes: Standing
    ) -> Decision:
        """The decision with what keeps it from being carried out, and with the intents that it
        obeys; no fault of that harms it."""
        narrow = self._control.too_narrow
        try:
            obeyed = told_intents(decision, scene, wishes)
            decision = msgspec.structs.replace(decision, intents=obeyed)
            return self._arrivals.told(decision, snapshot, scene, self.knowledge, narrow)
        except Exception:
            self._metrics.cycle_faults.inc()
            self._log.error("arrivals_failed", cycle=decision.cycle, exc_info=True)
            return decision

    def _say_demand(
        self, snapshot: Snapshot, scene: UnifiedScene | None, decision: Decision, control: Wish
    ) -> NetDemand | None:
        """Tells the network controller what Q_min takes, and robots how they fit; no fault of it
        harms the cycle."""
        if scene is None:
            return None
        try:
            demand = self._demand.take(
                scene,
                self.knowledge,
                decision,
                sent_ns=self._clock.now_ns(),
                steady_ns=self.monitor.stamp(),
                control=control,
                now_s=time.monotonic(),
            )
            demand = msgspec.structs.replace(
                demand,
                world=self.monitor.mark,
                software=installed_version(),
                told=told(snapshot, decision.remarks),
            )
            self._publish(lambda swarm, _: keyspace.net_demand(swarm), demand)
            self._metrics.demand(demand)
        except Exception:
            self._metrics.publish_failures.labels("demand").inc()
            self._log.error("demand_failed", cycle=decision.cycle, exc_info=True)
            return None
        return demand

    def _weighed(
        self, scene: UnifiedScene | None, decision: Decision, compared: Sequence[Compared]
    ) -> Weighed | None:
        """What the decision was weighed against: what the policy compared, or what `coverage` would
        have; no fault of it harms the cycle."""
        if scene is None:
            return None
        try:
            if compared:
                return weigh(compared[-1], decision)
            return weigh(compare(Scorer(scene, self.knowledge)), decision)
        except Exception:
            self._metrics.cycle_faults.inc()
            self._log.error("weigh_failed", cycle=decision.cycle, exc_info=True)
            return None

    def _next_probe(
        self,
        snapshot: Snapshot,
        scene: UnifiedScene | None,
        decision: Decision,
        wishes: Standing,
    ) -> Probe | None:
        """What the next decision shall ask on the side; no fault of it harms the cycle."""
        if scene is None:
            return None
        try:
            now_s = time.monotonic()
            return self._prober.take(scene, self.knowledge, decision, now_s) or self._unheard.take(
                snapshot, self.knowledge, decision, wishes, now_s
            )
        except Exception:
            self._metrics.cycle_faults.inc()
            self._log.error("probe_failed", cycle=decision.cycle, exc_info=True)
            return None

    def _publish(self, key: Callable[[str, str], str], message: Decision | NetDemand) -> bool:
        session = self._session
        if not self._lead.speaks():
            return False
        try:
            if session is None or session.links() == 0:
                raise TransportError("no router")
            session.put(key(session.swarm, self._ego), message)
        except TransportError as error:
            kind = "decision" if isinstance(message, Decision) else "demand"
            self._metrics.publish_failures.labels(kind).inc()
            self._log.debug(f"{kind}_unpublished", cycle=message.cycle, error=str(error))
            return False
        return True

    def _complete(self, running: _Running) -> None:
        """Writes the cycle's line; only then does the cycle count as completed."""
        tally = self.tally.take()
        self._arrivals.take(running.decision, tally)
        record = cycle_record(
            running.snapshot,
            running.scene,
            running.decision,
            tally,
            published=running.published,
            cycle_ms=running.cycle_ms,
            demand=running.demand,
            weighed=running.weighed,
        )
        self._steering.note(record)
        self.knowledge.record_result(cycle_result(running.decision, tally))
        if self._journal is None:
            self._metrics.committed(record)
        else:
            self._commit(self._journal, record)
        lost = self.fusion.unpublished
        self._metrics.publish_failures.labels("detections").inc(lost - self._detections_lost)
        self._detections_lost = lost
        counts = self.monitor.counts()
        self._count_ignored("out_of_order", counts.out_of_order)
        self._count_ignored("no_room", counts.no_room)
        self._log.info(
            "cycle",
            cycle=record.cycle,
            participants=list(record.decision.participants),
            algorithm=record.decision.algorithm,
            source=record.decision.source,
            fused=record.frames.fused,
            skipped=record.frames.skipped,
            outcome=record.outcome,
        )

    def _commit(self, journal: Journal, record: CycleRecord) -> None:
        try:
            for done in journal.commit(record):
                self._metrics.committed(done)
        except JournalError as error:
            self._metrics.journal_failures.inc()
            self._log.error("journal_refused", cycle=record.cycle, error=str(error))
        self._metrics.journal_pending.set(journal.pending)
        self._metrics.journal_lost.set(journal.dropped)

    def _count_ignored(self, reason: str, total: int) -> None:
        self._metrics.messages_ignored.labels(reason).inc(total - self._ignored[reason])
        self._ignored[reason] = total
