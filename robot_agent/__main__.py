"""The robot process: `python -m robot_agent`."""

from __future__ import annotations

import secrets
import sys
import threading
from collections.abc import Callable

from prometheus_client import CollectorRegistry

from perception.fusion.detectors import detector_backend
from robot_agent.agent import RobotAgent
from robot_agent.encoder import Encoder
from robot_agent.fit import Fit
from robot_agent.host import RobotHost
from robot_agent.metrics import RobotMetrics
from robot_agent.settings import RobotSettings, load_settings
from sensing.mark import mark_of
from sensing.opening import open_world_of
from swarm import zenoh_config
from swarm.announce import announce
from swarm.errors import CoAdaptError, SettingError
from swarm.log import make_logger
from swarm.loop_watch import Loops, LoopWatch, unwatched
from swarm.memory import keep_freed_memory
from swarm.metrics import serve_metrics
from swarm.process import Clock, leave, stop_on_signals
from swarm.session import Session
from swarm.settings import PREFIX
from swarm.trust.roles import Role
from worlds.base import World

MOVED = 75
"""Exit status (EX_TEMPFAIL of sysexits.h): the same command works, in the world that is now."""


def main() -> int:
    """Runs the robots of the settings until SIGTERM or SIGINT; returns what `serve` returns."""
    keep_freed_memory()
    return serve(load_settings, stop_on_signals())


def serve(load: Callable[[], RobotSettings], stop: threading.Event) -> int:
    """Runs robots until `stop` is set; returns 1, and says why, for settings that are wrong, and
    MOVED where the world that was learnt is another one."""
    try:
        settings = load()
        for robot in settings.robots:
            zenoh_config.check_router(settings.router, robot)
        with open_world_of(settings, "robot_agent", settings.robots[0]) as world:
            _check_robots(settings, world)
            watch = LoopWatch(make_logger("robot_agent", swarm=settings.swarm))
            moved = run(settings, world, stop, watch.loop)
    except CoAdaptError as error:
        if stop.is_set():
            return 0
        print(f"robot_agent: {error}", file=sys.stderr)
        return 1
    if moved:
        print(f"robot_agent: {moved}; ended to be started again", file=sys.stderr)
        return MOVED
    return 0


def run(
    settings: RobotSettings, world: World, stop: threading.Event, loops: Loops = unwatched
) -> str:
    """Hosts the robots in a world until `stop` is set; why it was, where the world was learnt and
    is another one now, else empty.

    Raises SettingError for a metrics port that is taken and TransportError when `stop` was set
    before the router could be reached.
    """
    moved: list[str] = []

    def on_moved(why: str) -> None:
        moved.append(why)
        stop.set()

    instance = secrets.randbits(48)
    log = make_logger(
        "robot_agent", level=settings.log_level, swarm=settings.swarm, instance=instance
    )
    registry = CollectorRegistry()
    metrics = RobotMetrics(registry)
    mark = mark_of(settings, world)
    encoder = Encoder(world.detector, metrics, settings.algorithms)
    metrics.hosts(settings.robots, encoder.algorithms)
    server = serve_metrics(registry, settings)
    try:
        log.info("robots_starting", robots=list(settings.robots), metrics_port=server.port)
        agents = [
            RobotAgent(
                world,
                robot,
                instance=instance,
                epoch_ns=settings.epoch_ns,
                encoder=encoder,
                clock=Clock(settings.clock_offset_s),
                metrics=metrics,
                log=log,
                ring_frames=settings.ring_frames,
                size_period_s=1 / settings.measure_rate_hz,
                mark=mark,
            )
            for robot in settings.robots
        ]
        with Session(
            settings.router, settings.swarm, registry=registry, log=log, stop=stop
        ) as session:
            announce(session, settings, Role("robot", settings.robots[0]), server.port)
            host = RobotHost(
                agents,
                session,
                beacon_rate_hz=settings.beacon_rate_hz,
                scene_rate_hz=settings.scene_rate_hz,
                measure_rate_hz=settings.measure_rate_hz,
                workers=settings.workers,
                areas=settings.areas,
                metrics=metrics,
                log=log,
                fit=Fit(
                    settings.robots,
                    mark,
                    f"swarm {settings.swarm!r} at {settings.router.partition('#')[0]}",
                    log,
                    on_moved if settings.world_learnt else None,
                ),
                loops=loops,
            )
            backend = detector_backend(world.detector)
            log.info("robots_up", robots=list(settings.robots), detector_backend=backend)
            stop.wait()
            host.close()
    finally:
        server.close()
    log.info("robots_down")
    return "".join(moved[:1])


def _check_robots(settings: RobotSettings, world: World) -> None:
    unknown = [robot for robot in settings.robots if robot not in world.robots]
    if unknown:
        raise SettingError(
            f"{PREFIX}ROBOTS = {','.join(settings.robots)!r} names {', '.join(unknown)}, which "
            f"world {world.name!r} does not have; allowed: {', '.join(world.robots)}"
        )


if __name__ == "__main__":
    leave(main())
