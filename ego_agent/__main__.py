"""The ego process: `python -m ego_agent`."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from pathlib import Path

from prometheus_client import CollectorRegistry

from ego_agent.execute.frame_fuser import FrameResult
from ego_agent.metrics import EgoMetrics
from ego_agent.settings import EgoSettings, load_settings
from ego_agent.wiring import ego_of
from perception.fusion.detectors import detector_backend
from sensing.opening import open_world_of
from swarm import zenoh_config
from swarm.announce import announce
from swarm.errors import CoAdaptError, SettingError, TransportError
from swarm.log import make_logger
from swarm.loop_watch import Loops, LoopWatch, unwatched
from swarm.memory import collect_rarely, keep_freed_memory
from swarm.metrics import serve_metrics, show_free_disk
from swarm.process import leave, stop_on_signals
from swarm.session import Session
from swarm.settings import PREFIX
from swarm.trust.roles import Role
from worlds.base import World


def main() -> int:
    """Runs one ego until SIGTERM or SIGINT; wrong settings end it at once with 1."""
    keep_freed_memory()
    stop = stop_on_signals()
    try:
        settings = load_settings()
        zenoh_config.check_router(settings.router, Role("ego", settings.ego).common_name)
        with open_world_of(settings, "ego_agent", settings.ego) as world:
            _check_ego(settings, world)
            collect_rarely()
            watch = LoopWatch(make_logger("ego_agent", swarm=settings.swarm, ego=settings.ego))
            run(settings, world, stop, loops=watch.loop)
    except CoAdaptError as error:
        print(f"ego_agent: {error}", file=sys.stderr)
        return 1
    return 0


def run(
    settings: EgoSettings,
    world: World,
    stop: threading.Event,
    on_result: Callable[[FrameResult], None] | None = None,
    loops: Loops = unwatched,
) -> None:
    """Runs one ego in a world until `stop` is set; `on_result` hears of each published frame.

    Raises SettingError for a metrics port that is taken, DecisionError for a policy that is
    unknown or cannot decide here, and JournalError for a journal that cannot be written.
    """
    log = make_logger("ego_agent", level=settings.log_level, swarm=settings.swarm, ego=settings.ego)
    registry = CollectorRegistry()
    if settings.journal:
        show_free_disk(registry, Path(settings.journal))
    agent = ego_of(settings, world, EgoMetrics(registry), log, on_result=on_result)
    try:
        server = serve_metrics(registry, settings)
    except SettingError:
        agent.close()
        raise

    def connect() -> Session | None:
        try:
            session = Session(
                settings.router, settings.swarm, registry=registry, log=log, stop=stop
            )
            announce(session, settings, Role("ego", settings.ego), server.port)
            return session
        except TransportError:
            return None  # stopped before the router could be reached

    log.info(
        "ego_up",
        policy=settings.policy,
        period_s=settings.period_s,
        metrics_port=server.port,
        detector_backend=detector_backend(world.detector),
    )
    try:
        agent.run(settings.period_s, stop, connect, loops)
    finally:
        server.close()
        agent.close()
    log.info("ego_down")


def _check_ego(settings: EgoSettings, world: World) -> None:
    if settings.ego not in world.robots:
        raise SettingError(
            f"{PREFIX}EGO = {settings.ego!r} is not in world {world.name!r}; "
            f"allowed: {', '.join(world.robots)}"
        )


if __name__ == "__main__":
    leave(main())
