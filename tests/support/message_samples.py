"""One message of every type, with fixed values: what the golden files hold.

`python -m tests.support.message_samples` writes tests/golden/ anew; do that only with a new schema
version.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from swarm.arrays import pack
from swarm.body import Body
from swarm.messages import (
    AdviceReport,
    AnswerReport,
    Assignment,
    Backlog,
    Beacon,
    CertificateRequest,
    ChatMessage,
    DecideAnswer,
    DecideRequest,
    Decision,
    Detections,
    EgoSteered,
    EgoSteering,
    EgoWish,
    GatewayState,
    KnownRobot,
    LinkClass,
    LinkState,
    LlmTimings,
    LlmTokens,
    Message,
    NetDemand,
    NetState,
    Observation,
    ObservationRequest,
    Probe,
    Refusal,
    RenewedCertificate,
    RobotSteered,
    RobotSteering,
    SceneDescription,
    ShapeInForce,
    ShapeReply,
    ShapeRequest,
    TcpState,
    Tracks,
    encode,
)
from tests.support.paths import GOLDEN

NOW = 1_800_000_000_123_456_789
POSE = (1.5, -2.25, 0.75, 0.0, -0.125, 3.0)

SAMPLES: tuple[Message, ...] = (
    Beacon(
        robot="R1",
        instance=281_474_976_710_655,
        seq=7,
        sent_ns=NOW,
        capture_ns=NOW - 50_000_000,
        frame=18_000_000_001,
        pose=POSE,
        velocity=(1.0, 0.5, 0.0),
        range_m=30.0,
        sizes={"early": 26_123, "late": 208},
        body=Body(label="robot", size=(0.9, 0.6, 1.26), center=(0.0, 0.0, -0.57)),
        steady_ns=55_000_000_123,
        echoes={"R2": (77_000_000_001, 54_990_000_000)},
        world="factory detector=factory epoch=0 robots=6 scenario=floor seed=1",
        software="1.0.0",
        shared=("early",),
    ),
    SceneDescription(
        robot="R1",
        instance=1,
        seq=2,
        sent_ns=NOW,
        capture_ns=NOW - 50_000_000,
        frame=3,
        pose=POSE,
        objects=pack(np.arange(18, dtype=np.float32).reshape(2, 9) / 4),
        visible_m=pack(np.linspace(0, 8, 4, dtype=np.float32).reshape(4, 1)),
        ground_points=12_345,
        elapsed_ms=3.5,
    ),
    ObservationRequest(
        ego="R2",
        request=9,
        algorithm="early",
        capture_ns=0,
        max_error_m=0.05,
        keep_ground=True,
        max_bytes=60_000,
        reference=POSE,
        demand=b"\x01\x02",
        shares=True,
        listens=True,
        rate_hz=5.0,
        deadline_s=0.25,
    ),
    Observation(
        robot="R1",
        instance=1,
        request=9,
        algorithm="early",
        capture_ns=NOW,
        frame=3,
        pose=POSE,
        payload=bytes(range(256)),
        encode_ms=4.25,
        uplink=Backlog(seen_ms=9_000, sent_bytes=70_000, stood_ms=40, stood_bytes=5_000),
        shared_s=2.0,
    ),
    Refusal(robot="R1", request=9, reason="no frame yet: über", code="busy"),
    Decision(
        ego="R2",
        cycle=12,
        decided_ns=NOW,
        participants=("R2", "R1"),
        algorithm="late",
        reason="only boxes fit the link",
        source="policy",
        policy="coverage",
        valid=True,
        repairs=("R3 left out: out of range",),
        quality=0.875,
        cost_bytes=208,
        rate_hz=10.0,
        capacity_bps=5e6,
        advice=AdviceReport(
            state="refused",
            gateway=True,
            question=4,
            asked_s=3.5,
            fingerprint="0123456789abcdef",
            refusal="refused: predicted quality 0.610, the fallback has 0.875",
            answer=AnswerReport(
                question=4,
                outcome="worse",
                why="refused: predicted quality 0.610, the fallback has 0.875",
                model="smollm2-135m",
                source="llm",
                latency_ms=900.5,
                tokens=LlmTokens(prompt=900, reused=700, output=40),
            ),
        ),
        deadline_s=0.25,
        arrival={"R1": 0.97},
        probe=Probe(robot="R1", algorithm="early", bytes=12_000),
        held_s=11.5,
        blind="nothing of what was chosen has arrived for 2 cycles (deadline)",
        excluded={"R3": "it is 60.0 m away, the range is 45.0 m"},
        silent={"R1": "nothing of it has arrived for 2 cycles (deadline)"},
        doubted={"R1": "2 robots see free ground where it says to stand"},
        ages_s={"R1": 0.125, "R2": 0.0625},
        stands_in_for="R1",
        assignments=(Assignment(robot="R1", algorithm="late", rate_hz=2.0),),
    ),
    Detections(
        ego="R2",
        cycle=12,
        frame=3,
        capture_ns=NOW,
        algorithm="late",
        participants=("R2", "R1"),
        missing={"R3": "deadline: no answer within 0.25 s"},
        missing_kinds={"R3": "deadline"},
        known=(
            KnownRobot(
                robot="R1",
                label="robot",
                center=(1.5, -2.25, 0.625),
                size=(0.9, 0.6, 1.26),
                heading=3.0,
                age_s=0.0625,
                doubt="2 robots see free ground where it says to stand",
            ),
        ),
        boxes=pack(np.arange(7, dtype=np.float32).reshape(1, 7)),
        scores=pack(np.array([[0.5]], dtype=np.float32)),
        operating_point=0.25,
        labels=("forklift",),
        bytes={"R1": 208},
        latency_ms=41.5,
        age_ms=64.25,
        tracks=Tracks(
            ids=(7,),
            labels=("forklift",),
            boxes=pack(np.arange(7, dtype=np.float32).reshape(1, 7)),
            scores=pack(np.array([[0.75]], dtype=np.float32)),
            velocities=pack(np.array([[1.5, -0.25]], dtype=np.float32)),
            ages_s=pack(np.array([[0.5]], dtype=np.float32)),
        ),
        forms={"R1": "late"},
    ),
    NetState(
        controller=281_474_976_710_655,
        seq=4,
        sent_ns=NOW,
        links=(
            LinkState(
                robot="R2",
                direction="down",
                capacity_bps=20_000_000,
                available_bps=15_000_000,
                latency_ms=1.5,
                level=1,
                classes={
                    "fusion": LinkClass(
                        rate_bps=15_000_000,
                        ceil_bps=20_000_000,
                        priority=1,
                        throughput_bps=1_000_000,
                        sent_bytes=1,
                        backlog_bytes=0,
                        drops=2,
                        overlimits=3,
                        backlog=Backlog(
                            seen_ms=4_000, sent_bytes=9_000, stood_ms=250, stood_bytes=8_000
                        ),
                    )
                },
                grants={"R2": 15_000_000},
            ),
        ),
        name="hall-2",
        robots=("R2", "R7"),
        unshaped=("R7 down: tc refuses to shape eth1",),
    ),
    TcpState(
        router=281_474_976_710_655,
        seq=5,
        sent_ns=NOW,
        peers={
            "10.77.1.1:40332": Backlog(
                seen_ms=500, sent_bytes=62_500, stood_ms=100, stood_bytes=12_500
            )
        },
    ),
    NetDemand(
        ego="R2",
        cycle=12,
        sent_ns=NOW,
        needed_bytes_s=231_250,
        possible=True,
        reachable=False,
        unreachable_s=2.5,
        quality=0.75,
        q_min=0.9,
        capacity_bps=1_000_000,
        steady_ns=77_000_000_001,
        control_bps=12_000,
        fewer_bps={"R1": 6_000},
        world="factory detector=factory epoch=0 robots=6 scenario=floor seed=1",
        software="1.0.0",
        told={"R7": "it lives in another world: seed 2 (the ego's: 1)"},
        mean_bytes_s=30_000,
        burst_bytes=12_000,
    ),
    ShapeRequest(
        request=3,
        operator="anna",
        robot="R3",
        direction="both",
        profile="trace",
        rates_bps=(5_000_000, 0, 2_500_000),
        interval_s=0.5,
        duration_s=60.0,
        revision=8,
    ),
    EgoSteering(request=12, operator="ann@floor", wish=EgoWish(policy="static-late", q_min=0.6)),
    EgoSteered(
        request=12, ego="R1", policy="static-late", q_min=0.6, policies=("coverage", "static-late")
    ),
    CertificateRequest(request=14, role="R7", operator="R7"),
    RenewedCertificate(request=14, certificate="-----BEGIN CERTIFICATE-----"),
    RobotSteering(request=13, operator="ann@floor", duty="off"),
    RobotSteered(request=13, robot="R3", on_duty=False, operator="ann@floor", since_ns=NOW),
    ShapeReply(
        request=3,
        revision=9,
        shapes=(
            ShapeInForce(
                robot="R3",
                direction="up",
                profile="trace",
                rate_bps=5_000_000,
                operator="anna",
                since_ns=NOW,
                until_ns=NOW + 60_000_000_000,
            ),
        ),
        congested=("R2",),
        notes=("netem is missing",),
    ),
    DecideRequest(
        request=7,
        ego="R1",
        messages=(ChatMessage("system", "Choose."), ChatMessage("user", "C(t) 20 Mbit/s")),
        schema='{"type":"object"}',
        fingerprint="0123456789abcdef",
        deadline_s=10.0,
        max_tokens=120,
    ),
    DecideAnswer(
        request=7,
        decision='{"algorithm":"late","participants":["R1"]}',
        source="cache",
        hit="fingerprint",
        model="smollm2-135m",
        age_s=12.5,
        tokens=LlmTokens(prompt=900, reused=700, output=40),
        timings=LlmTimings(queue_ms=0.5, model_ms=900.0, total_ms=901.0),
    ),
    GatewayState(model="smollm2-135m", trouble="refused by 127.0.0.1:8000"),
)


def golden_path(message: Message) -> Path:
    return GOLDEN / f"{type(message).__name__.lower()}.msgpack"


if __name__ == "__main__":
    GOLDEN.mkdir(exist_ok=True)
    for sample in SAMPLES:
        golden_path(sample).write_bytes(encode(sample))
