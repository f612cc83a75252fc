"""Operators' requests, checked and turned into wishes."""

from __future__ import annotations

from collections.abc import Sequence

from network_controller.model import DIRECTIONS, Link
from network_controller.wishes import Wish
from swarm.errors import NetworkError
from swarm.messages import ShapeRequest

UTILISATION = 0.85
"""Of the capacity, by default, for competing telemetry: the paper's third motivating snapshot."""
CONGEST_S = 30.0
MIN_STEP_S = 0.05
_NS = 1_000_000_000


def links_of(
    request: ShapeRequest, ego: str, present: frozenset[str], others: Sequence[str] = ()
) -> tuple[Link, ...]:
    """The links that a request means; without a robot the cell towards the ego first, and towards
    the others that decide, or stand in for it.

    Raises NetworkError for a robot that is not on this host.
    """
    robot = request.robot or ego
    if robot not in present:
        raise NetworkError(
            f"robot {robot!r} has no link on this host; there are {', '.join(sorted(present))}"
            if present
            else f"robot {robot!r} has no link on this host: no robot is here"
        )
    directions = DIRECTIONS if request.direction == "both" else (request.direction,)
    more = () if request.robot else tuple(r for r in others if r in present and r != robot)
    return tuple(Link(r, direction) for r in (robot, *more) for direction in directions)


def wish_of(request: ShapeRequest, link: Link, now_ns: int) -> Wish:
    """The wish for one link. Raises NetworkError where the request lacks what its profile needs."""
    kind = request.profile
    rates: tuple[int, ...] = ()
    if kind == "rate":
        if request.rate_bps is None:
            raise NetworkError("profile 'rate' needs rate_bps, bit/s")
        rates = (request.rate_bps,)
    elif kind == "trace":
        if not any(request.rates_bps):
            raise NetworkError("profile 'trace' needs rates_bps: bit/s by interval, not all 0")
        rates = request.rates_bps
    elif kind != "shift":
        raise NetworkError(f"profile {kind!r} is no shape; shapes are rate, shift and trace")
    if kind == "trace" and request.interval_s / request.time_scale < MIN_STEP_S:
        raise NetworkError(
            f"interval_s / time_scale is {request.interval_s / request.time_scale:g} s; a trace "
            f"may change the link every {MIN_STEP_S} s at most"
        )
    for_ns = 0 if request.duration_s is None else round(request.duration_s * _NS)
    return Wish(
        robot=link.robot,
        direction=link.direction,
        layer="expires" if for_ns else "stays",
        kind=kind,
        operator=request.operator or "unknown",
        since_ns=now_ns,
        until_ns=now_ns + for_ns if for_ns else 0,
        rates_bps=rates,
        interval_s=request.interval_s,
        time_scale=request.time_scale,
        delay_ms=request.delay_ms,
        loss=request.loss,
    )
