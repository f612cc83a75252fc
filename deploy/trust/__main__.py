"""Renews a swarm's certificates while it runs: `python -m deploy.trust`.

Who has a copy of its own on another machine asks for the new one at the router.
"""

from __future__ import annotations

import sys
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Annotated

import msgspec
from prometheus_client import CollectorRegistry, Gauge

from deploy.trust.copies import Copies
from deploy.trust.keystore import Keystore
from deploy.trust.metrics import AuthorityMetrics
from deploy.trust.prepare import LifeSettings
from swarm.defaults import SWARM
from swarm.errors import CoAdaptError, IdentityError
from swarm.log import Logger, make_logger
from swarm.loop_watch import LOOK_S, LoopWatch
from swarm.metrics import MetricsServer
from swarm.process import leave, stop_on_signals
from swarm.settings import Name, Port, load

LOOKS = 12
"""So often in a certificate's life it is looked at."""
MAX_PERIOD_S = 60.0


class AuthoritySettings(LifeSettings, frozen=True, kw_only=True):
    """Settings of the authority's process."""

    keystore: Annotated[str, msgspec.Meta(min_length=1)]
    swarm: Name = SWARM
    router: str = ""
    """Where it gives its copies to processes on other machines; empty: to none."""
    metrics_host: str = "127.0.0.1"
    metrics_port: Port = 9108


def renew_due(store: Keystore, told: set[str], left: Gauge, log: Logger) -> set[str]:
    """Renews what is due, and tells how long each certificate still holds. `told` are the names of
    which that was told before; returns those of which it is now."""
    now = datetime.now(UTC)
    issued = {one.name: one for one in store.issued()}
    names = set(store.names()) - {name for name, one in issued.items() if one.revoked}
    for name in told - names:
        left.remove(name)
    for name in sorted(names):
        one = issued.get(name)
        if one is None:
            log.error("not_renewed", name=name, error="its certificate cannot be read")
            left.labels(name).set(0)
            continue
        end = one.end
        if store.due(one, now):
            try:
                end = store.renew(name)
                log.info("renewed", name=name, until=end.isoformat())
            except IdentityError as error:
                log.error("not_renewed", name=name, error=str(error))
        left.labels(name).set((end - now).total_seconds())
    return names


def main() -> int:
    """Renews until SIGTERM or SIGINT."""
    log = make_logger("authority")
    stop = stop_on_signals()
    try:
        settings = load(AuthoritySettings)
        registry = CollectorRegistry()
        metrics = AuthorityMetrics(registry, settings.certificate_life_s)
        server = MetricsServer(registry, settings.metrics_port, settings.metrics_host)
    except CoAdaptError as error:
        print(f"deploy.trust: {error}", file=sys.stderr)
        return 1
    life_s = settings.certificate_life_s
    store = Keystore(Path(settings.keystore), timedelta(seconds=life_s))
    copies = Copies(store, settings.router, settings.swarm, log) if settings.router else None
    log.info("authority_up", keystore=settings.keystore, life_s=life_s)
    turned = LoopWatch(log).loop("authority")
    due = 0.0
    told: set[str] = set()
    while not stop.wait(LOOK_S):
        turned()
        if time.monotonic() < due:
            continue
        due = time.monotonic() + min(MAX_PERIOD_S, life_s / LOOKS)
        try:
            told = renew_due(store, told, metrics.left, log)
        except IdentityError as error:
            log.error("not_renewed", error=str(error))
    if copies is not None:
        copies.close()
    server.close()
    log.info("authority_down")
    return 0


if __name__ == "__main__":
    leave(main())
