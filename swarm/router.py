"""The swarm's Zenoh router as a Python process: `python -m swarm.router`.

A stock `zenohd` does the same with the file that `--print-config` writes, and with the environment
variable `ZENOH_RUNTIME` set to this module's RUNTIME.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import zenoh
from prometheus_client import CollectorRegistry, Gauge

from swarm import keyspace, transport
from swarm.defaults import ROUTER_PORT
from swarm.errors import CoAdaptError, SettingError
from swarm.log import make_logger
from swarm.loop_watch import LOOK_S, LoopWatch
from swarm.messages import Backlog, TcpState, encode
from swarm.metrics import MetricsServer
from swarm.process import leave, stop_on_signals
from swarm.tcp_watch import TcpWatch
from swarm.traffic import TrafficClass

RUNTIME = "(rx: (worker_threads: 16))"
"""A thread that forwards to a slow link waits for room in its queue. With Zenoh's two, two robots'
answers to one slow ego stop everything that the router receives, beacons and tokens included."""


NEWS_BYTES = 5_000
"""A connection that has carried less since it was told of, and stood not, shows nothing."""
MAX_PEERS = 256


def read_config(path: Path) -> dict[str, object]:
    """A JSON configuration file as settings. Raises SettingError when it cannot be read."""
    try:
        config = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise SettingError(f"router configuration {str(path)!r} cannot be read: {error}") from error
    if not isinstance(config, dict):
        raise SettingError(f"router configuration {str(path)!r} is not an object")
    return config


def serve_metrics(session: zenoh.Session, host: str, port: int) -> MetricsServer:
    """Serves how many sessions and links the router has. Raises SettingError for a taken port."""
    registry = CollectorRegistry()
    sessions = Gauge("coadapt_router_sessions", "Processes connected.", registry=registry)
    sessions.set_function(lambda: len(list(session.info.transports())))
    links = Gauge("coadapt_router_links", "Transport links of all sessions.", registry=registry)
    links.set_function(lambda: len(list(session.info.links())))
    return MetricsServer(registry, port, host)


class TcpReporter:
    """Publishes how a router's connections of the fusion class are doing, until closed."""

    def __init__(self, session: zenoh.Session, swarm: str) -> None:
        self._session = session
        self._key = keyspace.net_tcp(swarm)
        self._number = random.getrandbits(48)
        self._seq = 0
        self._told: dict[str, Backlog] = {}
        self._watch = TcpWatch(on_look=self._report)

    def close(self) -> None:
        """Publishes no more."""
        self._watch.close()

    def _report(self, seen: Mapping[str, Backlog]) -> None:
        news = {peer: now for peer, now in seen.items() if self._is_news(peer, now)}
        self._told = {peer: now for peer, now in (self._told | news).items() if peer in seen}
        if not news:
            return
        self._seq += 1
        state = TcpState(
            router=self._number,
            seq=self._seq,
            sent_ns=time.time_ns(),
            peers=dict(list(news.items())[:MAX_PEERS]),
        )
        # Zenoh closes the session on another thread when the process ends.
        with suppress(zenoh.ZError):
            self._session.put(
                self._key,
                encode(state),
                priority=TrafficClass.CONTROL.priority,
                congestion_control=zenoh.CongestionControl.DROP,
                express=True,
            )

    def _is_news(self, peer: str, now: Backlog) -> bool:
        before = self._told.get(peer, Backlog())
        return now.stood_ms > before.stood_ms or now.sent_bytes - before.sent_bytes >= NEWS_BYTES


def main() -> int:
    """Runs a router until SIGTERM or SIGINT."""
    parser = argparse.ArgumentParser(prog="python -m swarm.router", description=__doc__)
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on")
    parser.add_argument(
        "--port", type=int, default=ROUTER_PORT, help="first of three ports, one a class"
    )
    parser.add_argument("--unix-socket", help="also listen on this Unix socket")
    parser.add_argument(
        "--metrics-port", type=int, help="serve /metrics on this port of the same address"
    )
    parser.add_argument("--config", type=Path, help="a configuration file instead of the above")
    parser.add_argument("--print-config", action="store_true", help="print the file and exit")
    parser.add_argument(
        "--swarm", help="tell the egos of this swarm how the connections to them are doing"
    )
    args = parser.parse_args()
    log = make_logger("router")
    stop = stop_on_signals()
    try:
        config = (
            read_config(args.config)
            if args.config
            else transport.router_config(args.host, args.port, args.unix_socket)
        )
        if args.print_config:
            print(transport.router_json5(config), end="")
            return 0
        if args.unix_socket:
            Path(args.unix_socket).unlink(missing_ok=True)
        # Zenoh reads it once, before the process's first session.
        os.environ.setdefault("ZENOH_RUNTIME", RUNTIME)
        session = transport.open_zenoh({"mode": "router", **config})
        metrics = (
            serve_metrics(session, args.host, args.metrics_port)
            if args.metrics_port is not None
            else None
        )
        reporter = TcpReporter(session, args.swarm) if args.swarm else None
    except CoAdaptError as error:
        print(f"swarm.router: {error}", file=sys.stderr)
        return 1
    log.info("router_up", zid=str(session.info.zid()), port=args.port)
    turned = LoopWatch(log).loop("router")
    while not stop.wait(LOOK_S):
        list(session.info.links())  # does not return while Zenoh hangs
        turned()
    if reporter is not None:
        reporter.close()
    if metrics is not None:
        metrics.close()
    transport.close_zenoh(session)
    log.info("router_down")
    return 0


if __name__ == "__main__":
    leave(main())
