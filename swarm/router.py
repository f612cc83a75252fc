"""The swarm's Zenoh router as a Python process: `python -m swarm.router`.

A stock `zenohd` does the same with the file that `--print-config` writes, and with the environment
variable `ZENOH_RUNTIME` set to this module's RUNTIME.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path

import zenoh
from prometheus_client import CollectorRegistry, Gauge

from swarm import transport
from swarm.errors import CoAdaptError, SettingError
from swarm.log import make_logger
from swarm.metrics import MetricsServer
from swarm.process import leave, stop_on_signals

RUNTIME = "(rx: (worker_threads: 16))"
"""A thread that forwards to a slow link waits for room in its queue. With Zenoh's two, two robots'
answers to one slow ego stop everything that the router receives, beacons and tokens included."""


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


def main() -> int:
    """Runs a router until SIGTERM or SIGINT."""
    parser = argparse.ArgumentParser(prog="python -m swarm.router", description=__doc__)
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on")
    parser.add_argument("--port", type=int, default=7447, help="first of three ports, one a class")
    parser.add_argument("--unix-socket", help="also listen on this Unix socket")
    parser.add_argument(
        "--metrics-port", type=int, help="serve /metrics on this port of the same address"
    )
    parser.add_argument("--config", type=Path, help="a configuration file instead of the above")
    parser.add_argument("--print-config", action="store_true", help="print the file and exit")
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
    except CoAdaptError as error:
        print(f"swarm.router: {error}", file=sys.stderr)
        return 1
    log.info("router_up", zid=str(session.info.zid()), port=args.port)
    stop.wait()
    if metrics is not None:
        metrics.close()
    transport.close_zenoh(session)
    log.info("router_down")
    return 0


if __name__ == "__main__":
    leave(main())
