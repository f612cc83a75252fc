"""The swarm's Zenoh router as a Python process: `python -m swarm.router`.

A stock `zenohd` does the same with the file that `--print-config` writes, and with the environment
variable `ZENOH_RUNTIME` set to this module's RUNTIME.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import zenoh
from prometheus_client import CollectorRegistry, Gauge

from swarm import keyspace, transport, zenoh_config
from swarm.announce import PLACE, bracketed
from swarm.defaults import ROUTER_PORT
from swarm.errors import CoAdaptError, IdentityError, SettingError, TransportError
from swarm.log import make_logger
from swarm.loop_watch import LOOK_S, LoopWatch
from swarm.metrics import MetricsServer
from swarm.peers import Peers
from swarm.process import leave, stop_on_signals
from swarm.refusals import Refusals
from swarm.targets import Targets
from swarm.tcp.dead import GiveUp
from swarm.tcp.peers import PeerTraffic
from swarm.tcp.reporter import TcpReporter
from swarm.tcp.stuck import Way
from swarm.trust import members
from swarm.trust.identity import Identity
from swarm.trust.members import Trust
from swarm.trust.renewal import Renewal, last_issued
from swarm.trust.roles import role_of

RUNTIME = "(rx: (worker_threads: 16))"
"""A thread that forwards to a slow link waits for room in its queue. With Zenoh's two, two robots'
answers to one slow ego stop everything that the router receives, beacons and tokens included."""
REOPEN_S = 10.0
"""How long a router that opens anew may take to close and to have its ports back; less than what it
is watched for."""
LOCAL_HOSTS = ("127.0.0.1", "localhost", "::1", "[::1]")


def read_config(path: Path) -> dict[str, object]:
    """A JSON configuration file as settings. Raises SettingError when it cannot be read."""
    try:
        config = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise SettingError(f"router configuration {str(path)!r} cannot be read: {error}") from error
    if not isinstance(config, dict):
        raise SettingError(f"router configuration {str(path)!r} is not an object")
    return config


def serve_metrics(
    router: Router,
    host: str,
    port: int,
    refusals: Refusals | None = None,
    identity: Identity | None = None,
) -> MetricsServer:
    """Serves how many sessions and links the router has, and a secure one how many it refused;
    with an identity, over TLS. Raises SettingError for a taken port."""
    registry = CollectorRegistry()
    sessions = Gauge("coadapt_router_sessions", "Processes connected.", registry=registry)
    sessions.set_function(lambda: router.connected()[0])
    links = Gauge("coadapt_router_links", "Transport links of all sessions.", registry=registry)
    links.set_function(lambda: router.connected()[1])
    registry.register(router.traffic)
    if refusals is not None:
        registry.register(refusals.counted)
    return MetricsServer(registry, port, host, identity)


class Router:
    """A router's session and what it tells of its connections, until closed. Opened again it lets
    all who are connected come anew."""

    def __init__(
        self,
        configure: Callable[[], dict[str, object]],
        swarm: str | None,
        unix_socket: str | None,
        targets: Targets | None = None,
        token: str = "",
    ) -> None:
        """`token`: the key of `keyspace.metrics` that says where its own are; empty for none.

        Raises what `configure`, which gives the settings, raises, and TransportError.
        """
        self._targets = targets
        self._token = token
        self.traffic = PeerTraffic()
        self._configure = configure
        self._swarm = swarm
        self._unix_socket = unix_socket
        self._open(configure())

    def reopen(self) -> None:
        """Closes and opens with what `configure` gives now. Raises what that raises, with nothing
        closed then, and TransportError."""
        config = self._configure()
        if self._reporter is not None:
            self._reporter.close()
        transport.close_zenoh(self.session, patience_s=REOPEN_S)
        deadline = time.monotonic() + REOPEN_S
        while True:
            try:
                self._open(config)
                return
            except TransportError:
                # Its ports may be free a moment later than it has said.
                if time.monotonic() >= deadline:
                    raise
                time.sleep(0.1)

    def connected(self) -> tuple[int, int]:
        """How many sessions and links it has."""
        try:
            info = self.session.info
            return len(list(info.transports())), len(list(info.links()))
        except zenoh.ZError:
            return 0, 0  # It is opening anew.

    def ends(self) -> list[str]:
        """The far ends of its links."""
        try:
            return [str(link.dst) for link in self.session.info.links()]
        except zenoh.ZError:
            return []  # It is opening anew.

    def certificate(self, name: str) -> str:
        """What the authority, at another machine's router, issued last to this one. Raises
        TransportError, and RefusedError."""
        return last_issued(self.session, self._swarm or "", name)

    def close(self) -> None:
        """Lets go of all."""
        if self._reporter is not None:
            self._reporter.close()
        transport.close_zenoh(self.session)

    def _open(self, config: dict[str, object]) -> None:
        if self._unix_socket:
            Path(self._unix_socket).unlink(missing_ok=True)
        self.session = transport.open_zenoh({"mode": "router", **config})
        self._reporter = (
            TcpReporter(self.session, self._swarm, self.traffic.take) if self._swarm else None
        )
        if self._targets is not None:
            self._targets.attach(self.session)
        if self._token:
            # Kept: a token ends with what declares it.
            self._held = self.session.liveliness().declare_token(self._token)


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
    parser.add_argument(
        "--identity",
        type=Path,
        metavar="FOLDER",
        help="let in only who has a certificate of this router's authority (docs/security.md)",
    )
    parser.add_argument(
        "--metrics-tls",
        action="store_true",
        help="serve them over TLS, with the certificate of --identity",
    )
    parser.add_argument(
        "--targets",
        type=Path,
        metavar="FILE",
        help="keep a file for Prometheus of where the swarm's processes serve metrics (file_sd)",
    )
    parser.add_argument(
        "--scouting", action="store_true", help="answer who looks for a router by multicast"
    )
    parser.add_argument(
        "--peer",
        action="append",
        default=[],
        metavar="ROUTER",
        help="another machine's router, tls/HOST:PORT (plain: tcp/HOST:PORT); repeatable. Of two "
        "routers one names the other",
    )
    args = parser.parse_args()
    log = make_logger("router")
    stop = stop_on_signals()
    identity = Identity(args.identity.absolute()) if args.identity else None
    if args.config and identity is not None:
        parser.error("--config and --identity do not go together: the file says all")
    if args.metrics_tls and identity is None:
        parser.error("--metrics-tls needs --identity: whose certificate it shows")
    if args.targets and not args.swarm:
        parser.error("--targets needs --swarm: whose processes they are")

    def configure() -> dict[str, object]:
        if args.config:
            return read_config(args.config)
        trust = _trust(identity, args.swarm) if identity is not None else None
        return zenoh_config.router_config(
            args.host, args.port, args.unix_socket, trust, args.peer, scouting=args.scouting
        )

    try:
        if args.print_config:
            print(zenoh_config.router_json5(configure()), end="")
            return 0
        # Zenoh reads it once, before the process's first session.
        os.environ.setdefault("ZENOH_RUNTIME", RUNTIME)
        refusals = Refusals(log) if identity is not None else None
        seen = members.version(identity) if identity is not None else ()
        targets = Targets(args.targets, args.swarm, log) if args.targets and args.swarm else None
        token = _token(identity, args)
        router = Router(configure, args.swarm, args.unix_socket, targets, token)
        metrics = (
            serve_metrics(
                router,
                args.host,
                args.metrics_port,
                refusals,
                identity if args.metrics_tls else None,
            )
            if args.metrics_port is not None
            else None
        )
    except CoAdaptError as error:
        print(f"swarm.router: {error}", file=sys.stderr)
        return 1
    log.info("router_up", zid=str(router.session.info.zid()), port=args.port)
    if identity is None and args.host not in LOCAL_HOSTS and not args.config:
        log.warning("plain", host=args.host, means="whoever reaches this address is believed")
    turned = LoopWatch(log).loop("router")
    peers = Peers(args.peer, identity, log)
    way, give_up = Way(log), GiveUp()
    renewal = (
        Renewal(identity, partial(router.certificate, identity.name), log)
        if identity is not None and args.peer
        else None
    )
    while not stop.wait(LOOK_S):
        router.connected()  # does not return while Zenoh hangs
        turned()
        if targets is not None:
            targets.look()
        peers.look(router.ends() if args.peer else ())
        way.look()
        give_up.look()
        if identity is None or (now := members.version(identity)) == seen:
            continue
        seen = now
        try:
            router.reopen()
        except (IdentityError, SettingError) as error:
            log.error("trust_not_renewed", error=str(error))
        except TransportError as error:
            print(f"swarm.router: {error}", file=sys.stderr)
            return 1
        else:
            log.info("trust_renewed")
    if metrics is not None:
        metrics.close()
    if renewal is not None:
        renewal.close()
    router.close()
    if refusals is not None:
        refusals.close()
    log.info("router_down")
    return 0


def _token(identity: Identity | None, args: argparse.Namespace) -> str:
    """By which another machine's router tells where its metrics are. The swarm's first one stands
    in Prometheus' configuration."""
    anywhere = args.host in ("0.0.0.0", "::")
    if identity is None or args.metrics_port is None or anywhere:
        return ""
    if not role_of(identity.name).name:
        return ""
    scheme = "https" if args.metrics_tls else "http"
    place = f"{scheme}:{bracketed(args.host)}:{args.metrics_port}"
    return keyspace.metrics(args.swarm, identity.name, place) if PLACE.fullmatch(place) else ""


def _trust(identity: Identity, swarm: str | None) -> Trust:
    if not swarm:
        raise SettingError("--identity needs --swarm: rights are rights in one swarm")
    # Only here: the library takes 13 MB in every process that reads a certificate.
    from swarm.trust.certificates import check

    check(identity)
    return members.trust_of(identity, swarm)


if __name__ == "__main__":
    leave(main())
