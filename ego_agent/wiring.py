"""Puts an ego together from its settings and the world that it lives in."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from ego_agent.agent import EgoAgent
from ego_agent.execute.ask import Asker
from ego_agent.execute.frame_fuser import FrameResult
from ego_agent.execute.fusion_loop import FusionLoop, live_motion
from ego_agent.execute.sense import OwnSensor
from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.journal import Journal
from ego_agent.knowledge.objective import Objective
from ego_agent.knowledge.tally import TallyKeeper
from ego_agent.metrics import EgoMetrics
from ego_agent.monitor.known import KnownRobots
from ego_agent.monitor.leading import Alone, First, Lead, Standby
from ego_agent.monitor.link import LinkEstimate
from ego_agent.monitor.snapshot import Monitor
from ego_agent.monitor.surroundings import MAX_REACH_M, Surroundings
from ego_agent.plan.policies.base import Policy, Requiring
from ego_agent.plan.policies.registry import make_policy
from ego_agent.settings import EgoSettings
from ego_agent.steering import Steering
from perception.detector import configuration
from perception.detector.calibration import calibration_of
from perception.fusion.base import Fusion
from perception.fusion.mixed import mixable
from perception.fusion.registry import fusion_names, make_fusion
from perception.memory.poses import PoseMemory
from perception.memory.reprocessing import ReprocessingMemory
from sensing.mark import mark_of
from swarm.errors import SettingError
from swarm.log import Logger
from swarm.process import Clock
from swarm.settings import PREFIX
from worlds.base import World, comm_range_of


def ego_of(
    settings: EgoSettings,
    world: World,
    metrics: EgoMetrics,
    log: Logger,
    *,
    fusions: Mapping[str, Fusion] | None = None,
    on_result: Callable[[FrameResult], None] | None = None,
) -> EgoAgent:
    """An ego in a world; `close` it. `metrics` show at once what its journal holds.

    `fusions` by algorithm are those of the world's detector, where no others are given.
    `on_result` hears of each published frame, on the fusing thread.

    Raises SettingError where no algorithm can be used, DecisionError for a policy that is
    unknown or cannot decide here, PerceptionError for a calibration that is of other weights,
    and JournalError for a journal that cannot be written.
    """
    calibration_of(world.detector)  # else every frame would fail
    available = fusion_names(world.detector) if fusions is None else tuple(fusions)
    policy = make_policy(settings.policy, available)
    algorithms = _algorithms(settings, available, policy)
    metrics.decides_among(algorithms)
    if fusions is None:
        fusions = {name: make_fusion(name, world.detector) for name in algorithms}
    knowledge = Knowledge.of_detector(
        world.detector,
        settings.objective(comm_range_of(world), world.rate_hz),
        algorithms,
        learns=settings.learn,
        shares=settings.share,
        mixable=mixable(fusions),
    )
    clock = Clock()
    link = LinkEstimate(settings.link_prior_bps)
    monitor = Monitor(
        settings.ego,
        link,
        clock=clock,
        max_robots=settings.max_robots,
        surroundings=_surroundings(settings, knowledge.objective, log),
        mark=mark_of(settings, world),
    )
    tally = TallyKeeper()
    body = configuration(world.detector).usual_body
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
        share=settings.share,
    )
    lead = _lead(settings, log)
    poses = PoseMemory() if settings.memory else None
    fusion = FusionLoop(
        settings.ego,
        sensor,
        asker,
        fusions,
        live_motion(world.detector, world.rate_hz, poses),
        tally,
        log,
        detector=world.detector,
        memory=ReprocessingMemory.of_detector(world.detector) if settings.memory else None,
        poses=poses,
        known=KnownRobots(monitor, knowledge.objective.beacon_max_age_s, body),
        rate_hz=settings.fusion_rate_hz,
        deadline_s=settings.deadline_s,
        # In the middle of a cycle: what an answer shows is recent at the next one.
        probe_after_s=settings.period_s / 2.0,
        on_result=on_result,
        speaks=lead.speaks,
    )
    steering = Steering(settings, policy, knowledge, log, clock)
    journal = Journal(Path(settings.journal)) if settings.journal else None
    if journal is not None:
        metrics.restore(journal.totals)
        if journal.torn_bytes:
            log.warning("journal_torn", path=str(journal.path), bytes=journal.torn_bytes)
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
        usual_body=body,
        lead=lead,
        stands_in_for=settings.stands_in_for,
    )


def _surroundings(settings: EgoSettings, objective: Objective, log: Logger) -> Surroundings | None:
    """What the ego listens to; None: to everybody."""
    if not settings.areas:
        return None
    if objective.comm_range_m > MAX_REACH_M:
        log.warning("listens_to_all", range_m=objective.comm_range_m, most_m=MAX_REACH_M)
        return None
    return Surroundings(objective.comm_range_m, objective.area_half_m, log)


def _lead(settings: EgoSettings, log: Logger) -> Lead:
    """Which part this ego plays."""
    if settings.stands_in_for is not None:
        return Standby(settings.ego, settings.stands_in_for, settings.period_s, log)
    if settings.ego_standby is not None:
        return First(settings.ego, settings.ego_standby, log)
    return Alone()


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
