"""The network controller process: `python -m network_controller`."""

from __future__ import annotations

import random
import sys
import threading
from pathlib import Path

from prometheus_client import CollectorRegistry

from network_controller.controller import Controller
from network_controller.drivers.command import TIMEOUT_S
from network_controller.drivers.registry import make_driver
from network_controller.journal import Journal
from network_controller.metrics import ControllerMetrics
from network_controller.qod.server import Server
from network_controller.settings import ControllerSettings, load_settings
from network_controller.slow_loop import SlowLoop
from network_controller.telemetry.flows import Flows
from network_controller.wishes import Wish, Wishes
from swarm import keyspace, zenoh_config
from swarm.announce import announce
from swarm.errors import CoAdaptError, TransportError
from swarm.listening import hear
from swarm.log import Logger, make_logger
from swarm.loop_watch import Loops, LoopWatch, unwatched
from swarm.messages import LinkState, NetDemand, NetState, ShapeRequest
from swarm.metrics import serve_metrics, show_free_disk
from swarm.process import Clock, leave, stop_on_signals
from swarm.session import Session
from swarm.trust.roles import Role

MAX_TOLD, MAX_TROUBLES, MAX_WHY = 1024, 64, 300
"""As many robots, troubles and characters of one as a `NetState` may have."""


def main() -> int:
    """Controls the links of one host until SIGTERM or SIGINT; wrong settings end it with 1."""
    stop = stop_on_signals()
    try:
        settings = load_settings()
        role = Role("controller", settings.controller)
        zenoh_config.check_router(settings.router, role.common_name)
        run(settings, stop, LoopWatch(make_logger("network_controller", swarm=settings.swarm)).loop)
    except CoAdaptError as error:
        print(f"network_controller: {error}", file=sys.stderr)
        return 1
    return 0


def run(settings: ControllerSettings, stop: threading.Event, loops: Loops = unwatched) -> None:
    """Runs one controller until `stop` is set.

    Raises SettingError for an address that cannot be bound, JournalError for a journal that cannot
    be written, NetworkError for kept shapes that cannot be read.
    """
    log = make_logger("network_controller", level=settings.log_level, swarm=settings.swarm)
    registry = CollectorRegistry()
    metrics = ControllerMetrics(registry)
    if settings.net_journal:
        show_free_disk(registry, Path(settings.net_journal))
    clock = Clock()
    driver = make_driver(settings.driver, settings.swarm)
    wishes = Wishes(Path(settings.state_file) if settings.state_file else None, clock.now_ns())
    for ego in settings.cells:
        first = _first_wish(settings, ego, clock.now_ns())
        if first is not None:
            wishes.put(first)
    journal = Journal(Path(settings.net_journal)) if settings.net_journal else None
    server = serve_metrics(registry, settings)
    controller = Controller(
        driver,
        wishes,
        SlowLoop(settings.window_s, settings.windows),
        Flows(driver),
        metrics,
        journal,
        log,
        ego=settings.ego,
        others=settings.cells[1:],
        cell=settings.egos if settings.cell == "shared" else (),
        clock=clock,
    )
    api = Server(
        controller,
        settings.qod_host,
        settings.qod_port,
        settings.qod_token,
        registry,
        log,
        socket=settings.qod_socket,
        names=settings.qod_names,
        sinks=settings.qod_sinks,
    )
    controller.on_lost = api.lost
    controller.start()
    api.start()
    link = _Link(settings, controller, clock, registry, log, stop, server.port)
    turned = loops("control", TIMEOUT_S)
    worker = threading.Thread(
        target=controller.run, args=(stop, link.publish, turned), name="control"
    )
    worker.start()
    log.info("controller_up", driver=driver.name, metrics_port=server.port)
    try:
        link.serve()
        stop.wait()
    finally:
        stop.set()
        controller.wake()
        worker.join()
        api.close()
        controller.close()
        # No link is shaped any more: egos need not wait until the last word has gone stale.
        link.publish(())
        server.close()
        link.close()
        if journal is not None:
            journal.close()
    log.info("controller_down")


def _first_wish(settings: ControllerSettings, ego: str, now_ns: int) -> Wish | None:
    """What the swarm was started with, for the cell towards an ego."""
    if settings.link_bps is None and not settings.link_rates_bps:
        return None
    fixed = settings.link_bps is not None
    return Wish(
        robot=ego,
        direction="down",
        layer="start",
        kind="rate" if fixed else "trace",
        operator="up",
        since_ns=now_ns if fixed else settings.epoch_ns,
        rates_bps=(settings.link_bps,) if settings.link_bps else settings.link_rates_bps,
        interval_s=settings.link_interval_s,
    )


class _Link:
    """The controller on Zenoh: states out, demands and requests in."""

    def __init__(
        self,
        settings: ControllerSettings,
        controller: Controller,
        clock: Clock,
        registry: CollectorRegistry,
        log: Logger,
        stop: threading.Event,
        metrics_port: int,
    ) -> None:
        self._metrics_port = metrics_port
        self._settings = settings
        self._controller = controller
        self._clock = clock
        self._registry = registry
        self._log = log
        self._stop = stop
        self._number = random.getrandbits(48)
        self._seq = 0
        self._session: Session | None = None

    def serve(self) -> None:
        """Waits for the router, then answers; returns early when the process is to stop."""
        try:
            session = Session(
                self._settings.router,
                self._settings.swarm,
                registry=self._registry,
                log=self._log,
                stop=self._stop,
            )
        except TransportError:
            return
        role = Role("controller", self._settings.controller)
        announce(session, self._settings, role, self._metrics_port)
        hear(session, {NetDemand: self._controller.on_demand})
        key = keyspace.net_shape(session.swarm, self._settings.controller)
        session.serve(key, ShapeRequest, self._controller.request, workers=1)
        self._session = session
        self._log.info("router_reached")

    def publish(self, states: tuple[LinkState, ...]) -> None:
        """Sends the links' states; nothing is sent while there is no router."""
        self._seq += 1
        if self._session is None:
            return
        name = self._settings.controller
        state = NetState(
            controller=self._number,
            seq=self._seq,
            sent_ns=self._clock.now_ns(),
            links=states,
            name=name,
            robots=self._controller.robots()[:MAX_TOLD],
            unshaped=tuple(why[:MAX_WHY] for why in self._controller.troubles()[:MAX_TROUBLES]),
        )
        try:
            self._session.put(keyspace.net_state(self._session.swarm, name), state)
        except TransportError as error:
            self._log.debug("state_unpublished", error=str(error))

    def close(self) -> None:
        """Leaves the swarm."""
        if self._session is not None:
            self._session.close()


if __name__ == "__main__":
    leave(main())
