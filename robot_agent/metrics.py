"""What a robot process counts. Labels are bounded: hosted robots, algorithms, outcomes."""

from __future__ import annotations

from collections.abc import Sequence

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram

from swarm.metrics import start_at_zero

_SECONDS = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5)
_OUTCOMES = ("sent", "shared", "no_frame", "too_old", "too_large", "failed")


class RobotMetrics:
    """The metrics of one robot process, on the registry it was given."""

    def __init__(self, registry: CollectorRegistry) -> None:
        self.scans = Counter(
            "coadapt_robot_scans_total", "Scans taken.", ["robot"], registry=registry
        )
        self.skipped = Counter(
            "coadapt_robot_frames_skipped_total",
            "Frames left out because sensing was late.",
            ["robot"],
            registry=registry,
        )
        self.unreadable = Counter(
            "coadapt_robot_scans_unreadable_total",
            "Frames that the world could not give.",
            ["robot"],
            registry=registry,
        )
        self.scan_seconds = Histogram(
            "coadapt_robot_scan_seconds",
            "Time to get one scan.",
            buckets=_SECONDS,
            registry=registry,
        )
        self.scene_seconds = Histogram(
            "coadapt_robot_scene_seconds",
            "Time to describe one scan.",
            buckets=_SECONDS,
            registry=registry,
        )
        self.encode_seconds = Histogram(
            "coadapt_robot_encode_seconds",
            "Time to encode one payload.",
            ["algorithm"],
            buckets=_SECONDS,
            registry=registry,
        )
        self.payload_bytes = Gauge(
            "coadapt_robot_payload_bytes",
            "Encoded size of the newest measured frame.",
            ["robot", "algorithm"],
            registry=registry,
        )
        self.sent_bytes = Counter(
            "coadapt_robot_observation_bytes_total",
            "Payload bytes of observations handed to the network.",
            ["robot", "algorithm"],
            registry=registry,
        )
        self.requests = Counter(
            "coadapt_robot_requests_total",
            "Requests for an observation: sent, shared, no_frame, too_old, too_large or failed.",
            ["robot", "algorithm", "outcome"],
            registry=registry,
        )
        self.on_duty = Gauge(
            "coadapt_robot_on_duty",
            "1 while the robot is part of the swarm, 0 while an operator keeps it out.",
            ["robot"],
            registry=registry,
        )
        self.faults = Counter(
            "coadapt_robot_faults_total",
            "Failures within a loop, which went on.",
            ["loop"],
            registry=registry,
        )
        start_at_zero(self.faults, ("sense", "share", "beacon", "scene", "measure"))

    def hosts(self, robots: Sequence[str], algorithms: Sequence[str]) -> None:
        """Shows what these robots may do at 0."""
        for of_robot in (self.scans, self.skipped, self.unreadable):
            start_at_zero(of_robot, robots)
        start_at_zero(self.encode_seconds, algorithms)
        start_at_zero(self.sent_bytes, robots, algorithms)
        start_at_zero(self.requests, robots, algorithms, _OUTCOMES)
