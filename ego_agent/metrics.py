"""The ego's Prometheus metrics. All labels are bounded: robots by Monitor's limit, the rest by
fixed sets.

What the journal says too (bytes, frames, decisions) is counted only when a cycle's line has been
committed, with exactly the numbers of the line. Bytes go on from the journal's sums after a
restart, so the two agree at any time; frames and decisions count from the start of the process.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import get_args

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram

from ego_agent.execute.frame_round import MISSING_KINDS
from ego_agent.knowledge.journal import ByteTotals, CycleRecord, byte_totals
from ego_agent.knowledge.model import Snapshot, UnifiedScene
from ego_agent.plan.advice.metrics import AdviceMetrics
from swarm.messages import Decision, NetDemand, Source
from swarm.metrics import start_at_zero

_BUCKETS = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0)
_RESULTS = ("fused", "skipped", "failed")
MAX_MET = 256
"""Robots whose counters are shown before they count: each has a dozen, ids come from the network,
and an ego that drives across a large site meets all of its robots."""


class EgoMetrics:
    """All metrics of one ego, on the registry of its process."""

    def __init__(self, registry: CollectorRegistry) -> None:
        self.cycle_seconds = Histogram(
            "coadapt_ego_cycle_seconds",
            "From the snapshot to the published decision.",
            buckets=_BUCKETS,
            registry=registry,
        )
        self.frame_seconds = Histogram(
            "coadapt_ego_frame_seconds",
            "Median time a cycle from the first query to the fused boxes.",
            buckets=_BUCKETS,
            registry=registry,
        )
        self.decisions = Counter(
            "coadapt_ego_decisions_total",
            "Decisions of committed cycles.",
            ["source", "algorithm"],
            registry=registry,
        )
        self.received_bytes = Counter(
            "coadapt_ego_received_bytes_total",
            "Payload bytes received in committed cycles; equals the sum over the journal's lines.",
            ["robot", "algorithm"],
            registry=registry,
        )
        self.frames = Counter(
            "coadapt_ego_frames_total",
            "Frames that were fused, skipped for want of time, or could not be fused.",
            ["result"],
            registry=registry,
        )
        self.late_answers = Counter(
            "coadapt_ego_late_answers_total",
            "Observations that came after their frame's deadline.",
            registry=registry,
        )
        self.caught_up = Counter(
            "coadapt_ego_caught_up_total",
            "Of the late observations, those that memory has taken up.",
            registry=registry,
        )
        self.missing = Counter(
            "coadapt_ego_missing_total",
            "Frames without a chosen robot's contribution.",
            ["robot", "reason"],
            registry=registry,
        )
        self.participants = Gauge(
            "coadapt_ego_participants",
            "Robots in the decision in force, the ego included.",
            registry=registry,
        )
        self.capacity_bps = Gauge(
            "coadapt_ego_capacity_bps",
            "C(t): what the ego takes its link to deliver, bit/s.",
            registry=registry,
        )
        self.robot_capacity_bps = Gauge(
            "coadapt_ego_robot_capacity_bps",
            "What the ego takes a robot to deliver, bit/s: C(t), or its own link where narrower.",
            ["robot"],
            registry=registry,
        )
        self.capacity_known = Gauge(
            "coadapt_ego_capacity_known",
            "1 while C(t) is measured or told by the network controller, 0 while it is assumed.",
            registry=registry,
        )
        self.robot_alive = Gauge(
            "coadapt_ego_robot_alive",
            "1 while the ego sees a robot's liveliness token.",
            ["robot"],
            registry=registry,
        )
        self.robot_duplicate = Gauge(
            "coadapt_ego_robot_duplicate",
            "1 while two processes use a robot's id at the same time.",
            ["robot"],
            registry=registry,
        )
        self.robot_clock_offset = Gauge(
            "coadapt_ego_robot_clock_offset_seconds",
            "A robot's time of day minus the ego's.",
            ["robot"],
            registry=registry,
        )
        self.estimate_error = Gauge(
            "coadapt_link_estimate_error_ratio",
            "(measured - configured) / configured capacity for fusion; 0 while not compared.",
            registry=registry,
        )
        self.estimate_compared = Gauge(
            "coadapt_link_estimate_compared",
            "1 while the ego has measured what the network controller has configured.",
            registry=registry,
        )
        self.demand_bytes_s = Gauge(
            "coadapt_demand_bytes_per_second",
            "Capacity for the cheapest decision that reaches Q_min, bytes/s.",
            registry=registry,
        )
        self.unreachable_s = Gauge(
            "coadapt_q_min_unreachable_seconds",
            "For how long the link has kept the ego below Q_min.",
            registry=registry,
        )
        self.blind = Gauge(
            "coadapt_ego_blind",
            "1 while nobody can be used, nothing that was chosen arrives, or the ego is not valid.",
            registry=registry,
        )
        self.leads = Gauge(
            "coadapt_ego_leads",
            "1 while others hear what the ego decides, 0 while another ego leads in its stead.",
            registry=registry,
        )
        self.robots_unheard = Gauge(
            "coadapt_ego_robots_unheard",
            "Living robots in range that the ego cannot use, or whose scene is old.",
            registry=registry,
        )
        self.robots_silent = Gauge(
            "coadapt_ego_robots_silent",
            "Chosen robots of which nothing arrives.",
            registry=registry,
        )
        self.quality = Gauge(
            "coadapt_ego_predicted_quality",
            "Q(P, a) that the decision in force predicts.",
            registry=registry,
        )
        self.predicted_bytes = Gauge(
            "coadapt_ego_predicted_frame_bytes",
            "C(P, a): bytes a fused frame that the decision in force predicts.",
            registry=registry,
        )
        self.journal_failures = Counter(
            "coadapt_ego_journal_failures_total",
            "Cycles whose line the disk refused at first.",
            registry=registry,
        )
        self.journal_pending = Gauge(
            "coadapt_ego_journal_pending",
            "Journal lines that wait in memory.",
            registry=registry,
        )
        self.journal_lost = Gauge(
            "coadapt_ego_journal_lost_lines",
            "Journal lines that were given up because the disk refused too many.",
            registry=registry,
        )
        self.publish_failures = Counter(
            "coadapt_ego_publish_failures_total",
            "Messages that could not be published.",
            ["message"],
            registry=registry,
        )
        self.cycle_faults = Counter(
            "coadapt_ego_cycle_faults_total",
            "Cycles that failed within and went on with the ego alone.",
            registry=registry,
        )
        self.cycles_missed = Counter(
            "coadapt_ego_cycles_missed_total",
            "Cycles that were left out because an earlier one took too long.",
            registry=registry,
        )
        self.messages_ignored = Counter(
            "coadapt_ego_messages_ignored_total",
            "Valid messages that were not taken: old ones, and robots beyond the limit.",
            ["reason"],
            registry=registry,
        )
        self.advice = AdviceMetrics(registry)
        self._of_robots = (
            *(self.robot_capacity_bps, self.robot_alive),
            *(self.robot_duplicate, self.robot_clock_offset),
        )
        self._robots: set[str] = set()
        self._met: set[str] = set()
        """Robots whose counters begin at 0."""
        self._algorithms: tuple[str, ...] = ()
        start_at_zero(self.frames, _RESULTS)
        start_at_zero(self.publish_failures, ("decision", "demand", "detections"))
        start_at_zero(self.messages_ignored, ("out_of_order", "no_room"))

    def decides_among(self, algorithms: Iterable[str]) -> None:
        """Shows what may be decided, and received of each robot that comes, at 0 from then on."""
        self._algorithms = tuple(algorithms)
        start_at_zero(self.decisions, get_args(Source), self._algorithms)

    def links(self, snapshot: Snapshot) -> None:
        """Shows who is there and what a cycle takes the links to deliver; robots that were
        forgotten disappear."""
        self.capacity_bps.set(snapshot.capacity_bps)
        self.capacity_known.set(snapshot.capacity_source != "prior")
        error = snapshot.capacity_error
        self.estimate_error.set(0.0 if error is None else error)
        self.estimate_compared.set(error is not None)
        robots = {r: v for r, v in snapshot.robots.items() if r != snapshot.ego}
        for robot, view in robots.items():
            self.robot_capacity_bps.labels(robot).set(min(view.capacity_bps, snapshot.capacity_bps))
            self.robot_alive.labels(robot).set(view.alive)
            self.robot_duplicate.labels(robot).set(view.duplicate)
            self.robot_clock_offset.labels(robot).set(view.clock_offset_s)
        if len(self._met) < MAX_MET:
            new = robots.keys() - self._met
            start_at_zero(self.received_bytes, new, self._algorithms)
            start_at_zero(self.missing, new, MISSING_KINDS)
            self._met |= new
        for robot in self._robots - robots.keys():
            for gauge in self._of_robots:
                gauge.remove(robot)
        self._robots = set(robots)

    def decided(self, decision: Decision, scene: UnifiedScene | None) -> None:
        """Shows the decision of a cycle, and what keeps it from being carried out."""
        self.participants.set(len(decision.participants))
        self.quality.set(decision.quality)
        self.predicted_bytes.set(decision.cost_bytes)
        self.advice.show(decision.advice)
        self.blind.set(bool(decision.blind))
        self.robots_silent.set(len(decision.silent))
        self.robots_unheard.set(len(scene.unheard) + scene.unknown if scene else 0)

    def demand(self, demand: NetDemand) -> None:
        """Shows what the ego has said that it needs."""
        self.demand_bytes_s.set(demand.needed_bytes_s)
        self.unreachable_s.set(demand.unreachable_s)

    def restore(self, totals: ByteTotals) -> None:
        """Takes over the sums of a journal that goes on, so that both stay equal."""
        for (robot, algorithm), size in totals.items():
            self.received_bytes.labels(robot, algorithm).inc(size)

    def committed(self, record: CycleRecord) -> None:
        """Counts a cycle whose journal line is on the disk."""
        self.cycle_seconds.observe(record.latency.cycle_ms * 1e-3)
        if record.latency.frame_p50_ms is not None:
            self.frame_seconds.observe(record.latency.frame_p50_ms * 1e-3)
        self.decisions.labels(record.decision.source, record.decision.algorithm).inc()
        for (robot, algorithm), size in byte_totals(record).items():
            self.received_bytes.labels(robot, algorithm).inc(size)
        for result in _RESULTS:
            self.frames.labels(result).inc(getattr(record.frames, result))
        self.late_answers.inc(record.frames.late_answers)
        self.caught_up.inc(record.frames.caught_up)
        for robot, reasons in record.missing.items():
            for reason, count in reasons.items():
                self.missing.labels(robot, reason).inc(count)
        if record.advice is not None:
            self.advice.committed(record.advice)
