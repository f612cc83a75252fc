"""`coadapt metrics`: what Prometheus scrapes of a running swarm, its alerts and key figures."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import msgspec

from coadapt.arguments import add_swarm
from deploy.prometheus import Alert, Prometheus, Sample, Target
from deploy.state import need_state
from swarm.errors import DeployError

FIGURES = (
    ("decisions", "sum by (source, algorithm) (coadapt_ego_decisions_total) > 0"),
    ("received bytes", "sum by (robot, algorithm) (coadapt_ego_received_bytes_total) > 0"),
    ("received bytes/s", "sum by (robot) (rate(coadapt_ego_received_bytes_total[15s]))"),
    ("frames/s", "sum by (result) (rate(coadapt_ego_frames_total[15s]))"),
    ("missing", "sum by (robot, reason) (coadapt_ego_missing_total) > 0"),
    (
        "cycle p99 ms",
        "1000 * histogram_quantile(0.99, sum by (le) (coadapt_ego_cycle_seconds_bucket))",
    ),
    (
        "frame p50 ms",
        "1000 * histogram_quantile(0.5, sum by (le) (coadapt_ego_frame_seconds_bucket))",
    ),
    ("C(t) bit/s", "coadapt_ego_capacity_bps"),
    ("sessions at the router", "coadapt_router_sessions"),
)
"""Names of figures, and the PromQL expressions that they are; counts of what has happened."""
ADVICE_FIGURES = (
    ("advice", "sum by (outcome) (coadapt_ego_advice_total) > 0"),
    ("model requests", "sum by (source, outcome) (coadapt_llm_requests_total) > 0"),
    (
        "model p50 ms",
        "1000 * histogram_quantile(0.5, sum by (le) "
        '(coadapt_llm_latency_seconds_bucket{stage="model"}))',
    ),
    ("model breaker", "coadapt_llm_breaker_state"),
)
"""The same, where a language model is asked."""
_UNSHOWN = {"__name__", "job", "instance", "role"}


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds `metrics` to the command line."""
    parser = subparsers.add_parser(
        "metrics", help="show alerts and key figures", description=__doc__
    )
    parser.add_argument("--json", action="store_true", help="one object on standard output")
    add_swarm(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Asks the swarm's Prometheus and prints what it says."""
    state = need_state(args.swarm)
    if not state.prometheus_url:
        raise DeployError(f"swarm {args.swarm!r} runs without Prometheus")
    server = Prometheus(state.prometheus_url)
    targets, alerts = server.targets(), server.alerts()
    wanted = FIGURES + (ADVICE_FIGURES if state.spec.llm else ())
    figures = {name: server.query(expression) for name, expression in wanted}
    if args.json:
        found = {
            "url": state.prometheus_url,
            "targets": targets,
            "alerts": alerts,
            "figures": figures,
        }
        print(msgspec.json.encode(found).decode())
        return 0
    print(f"Prometheus at {state.prometheus_url}")
    for line in [*_targets(targets), *_alerts(alerts)]:
        print(line)
    for name, samples in figures.items():
        for line in _figure(name, samples):
            print(line)
    return 0


def _targets(targets: Sequence[Target]) -> list[str]:
    up = sum(target.health == "up" for target in targets)
    return [f"targets: {up} of {len(targets)} up"] + [
        f"  {target.instance}: {target.health} {target.error}".rstrip()
        for target in targets
        if target.health != "up"
    ]


def _alerts(alerts: Sequence[Alert]) -> list[str]:
    if not alerts:
        return ["alerts: none"]
    return ["alerts:"] + [f"  {a.severity} {a.name}: {a.summary} {a.description}" for a in alerts]


def _figure(name: str, samples: Sequence[Sample]) -> list[str]:
    if not samples:
        return [f"{name}: none yet"]
    rows = []
    for sample in samples:
        labels = ", ".join(v for k, v in sorted(sample.labels.items()) if k not in _UNSHOWN)
        rows.append(f"  {labels or 'all'}: {sample.value:,.1f}")
    return [f"{name}:", *rows]
