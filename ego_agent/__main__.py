"""The ego process: `python -m ego_agent`."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path

from prometheus_client import CollectorRegistry

from ego_agent.agent import EgoAgent
from ego_agent.execute.ask import Asker
from ego_agent.execute.fusion_loop import FrameResult, FusionLoop, live_motion
from ego_agent.execute.sense import OwnSensor
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.journal import Journal
from ego_agent.knowledge.tally import TallyKeeper
from ego_agent.metrics import EgoMetrics
from ego_agent.monitor.link import LinkEstimate
from ego_agent.monitor.snapshot import Monitor
from ego_agent.plan.policies.base import Policy, Requiring
from ego_agent.plan.policies.registry import make_policy
from ego_agent.settings import EgoSettings, load_settings
from ego_agent.steering import Steering
from perception.fusion.detectors import detector_backend
from perception.fusion.registry import fusion_names, make_fusion
from sensing.opening import open_world_of
from swarm import transport
from swarm.errors import CoAdaptError, SettingError, TransportError
from swarm.log import Logger, make_logger
from swarm.memory import keep_freed_memory
from swarm.metrics import MetricsServer
from swarm.process import Clock, leave, stop_on_signals
from swarm.session import Session
from swarm.settings import PREFIX
from worlds.base import World


def main() -> int:
    """Runs one ego until SIGTERM or SIGINT; wrong settings end it at once with 1."""
    keep_freed_memory()
    stop = stop_on_signals()
    try:
        settings = load_settings()
        transport.client_config(settings.router)  # a malformed address ends the process here
        with open_world_of(settings, "ego_agent", settings.ego) as world:
            _check_ego(settings, world)
            run(settings, world, stop)
    except CoAdaptError as error:
        print(f"ego_agent: {error}", file=sys.stderr)
        return 1
    return 0


def run(
    settings: EgoSettings,
    world: World,
    stop: threading.Event,
    on_result: Callable[[FrameResult], None] | None = None,
) -> None:
    """Runs one ego in a world until `stop` is set; `on_result` hears of each published frame.

    Raises SettingError for a metrics port that is taken, DecisionError for a policy that is
    unknown or cannot decide here, and JournalError for a journal that cannot be written.
    """
    log = make_logger("ego_agent", level=settings.log_level, swarm=settings.swarm, ego=settings.ego)
    registry = CollectorRegistry()
    metrics = EgoMetrics(registry)
    available = fusion_names(world.detector)
    policy = make_policy(settings.policy, available)
    knowledge = Knowledge(
        settings.objective(), _algorithms(settings, available, policy), learns=settings.learn
    )
    steering = Steering(settings, policy, knowledge.algorithms, log)
    journal = Journal(Path(settings.journal)) if settings.journal else None
    if journal is not None:
        # Before anybody can read them: a scrape never sees less than the journal holds.
        metrics.restore(journal.totals)
        if journal.torn_bytes:
            log.warning("journal_torn", path=str(journal.path), bytes=journal.torn_bytes)
    try:
        server = MetricsServer(registry, settings.metrics_port, settings.metrics_host)
    except SettingError:
        if journal is not None:
            journal.close()
        raise
    agent = _agent(settings, world, knowledge, steering, journal, metrics, log, on_result)

    def connect() -> Session | None:
        try:
            return Session(settings.router, settings.swarm, registry=registry, log=log, stop=stop)
        except TransportError:
            return None  # stopped before the router could be reached

    log.info(
        "ego_up",
        policy=policy.name,
        period_s=settings.period_s,
        metrics_port=server.port,
        detector_backend=detector_backend(world.detector),
    )
    try:
        agent.run(settings.period_s, stop, connect)
    finally:
        server.close()
        if journal is not None:
            journal.close()
        agent.close()
        steering.close()
    log.info("ego_down")


def _agent(
    settings: EgoSettings,
    world: World,
    knowledge: Knowledge,
    steering: Steering,
    journal: Journal | None,
    metrics: EgoMetrics,
    log: Logger,
    on_result: Callable[[FrameResult], None] | None,
) -> EgoAgent:
    clock = Clock()
    link = LinkEstimate(settings.link_prior_bps)
    monitor = Monitor(settings.ego, link, clock=clock)
    tally = TallyKeeper()
    sensor = OwnSensor(world, settings.ego, settings.epoch_ns, monitor, clock, log)
    asker = Asker(
        settings.ego,
        monitor,
        link,
        knowledge,
        tally,
        clock,
        1.0 / world.rate_hz,
        max_error_m=settings.max_error_m,
        keep_ground=settings.keep_ground,
    )
    fusion = FusionLoop(
        settings.ego,
        sensor,
        asker,
        {name: make_fusion(name, world.detector) for name in knowledge.algorithms},
        live_motion(world.detector, world.rate_hz),
        tally,
        log,
        rate_hz=settings.fusion_rate_hz,
        deadline_s=settings.deadline_s,
        on_result=on_result,
    )
    return EgoAgent(
        monitor=monitor,
        knowledge=knowledge,
        steering=steering,
        sensor=sensor,
        fusion=fusion,
        tally=tally,
        journal=journal,
        metrics=metrics,
        clock=clock,
        log=log,
    )


def _algorithms(settings: EgoSettings, available: Sequence[str], policy: Policy) -> tuple[str, ...]:
    """What is decided among: the settings' algorithms, and the one that the policy needs."""
    wanted = [name for name in settings.algorithms if name in available]
    if isinstance(policy, Requiring) and policy.requires not in wanted:
        wanted.append(policy.requires)
    if not wanted:
        raise SettingError(
            f"{PREFIX}ALGORITHMS = {','.join(settings.algorithms)!r} holds none that can be used "
            f"in world {settings.world!r}; allowed: {', '.join(available)}"
        )
    return tuple(wanted)


def _check_ego(settings: EgoSettings, world: World) -> None:
    if settings.ego not in world.robots:
        raise SettingError(
            f"{PREFIX}EGO = {settings.ego!r} is not in world {world.name!r}; "
            f"allowed: {', '.join(world.robots)}"
        )


if __name__ == "__main__":
    leave(main())
