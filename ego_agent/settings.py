"""Settings of the ego process."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

import msgspec

from ego_agent.knowledge.objective import Headroom, Objective, Weight
from ego_agent.knowledge.pace import PLACES_HZ, RARER_HZ, SLOWER_HZ, in_step
from ego_agent.monitor.robot_table import MAX_ROBOTS
from swarm.defaults import COMM_RANGE_M, PERIOD_S, POLICY, Q_MIN, CommRange, Period
from swarm.messages import ALGORITHMS
from swarm.messages.choices import QMin
from swarm.process import Algorithms, ProcessSettings
from swarm.settings import Name, load

PromptStyle = Literal["table", "paper", "short"]
"""How a language model is asked: with a row of coarse numbers for each of the best robots, in the
manner of the paper, with all that is seen, or in some hundred tokens for a small model."""
_USUAL = Objective()


class EgoSettings(ProcessSettings, frozen=True, kw_only=True):
    """How one ego decides, fetches and fuses. Field `q_min` is read from `COADAPT_Q_MIN`."""

    ego: Name = "R1"
    """The robot that fuses; its scans come from the world, never over the link."""
    ego_standby: Name | None = None
    """The ego that stands in for this one; None: nobody does."""
    stands_in_for: Name | None = None
    """The ego that this one stands in for; None: it decides in its own name."""
    policy: Name = POLICY
    algorithms: Algorithms = ALGORITHMS
    """Fusion algorithms that policies may choose from; those that cannot be used are left out."""
    period_s: Period = PERIOD_S
    fusion_rate_hz: Annotated[float, msgspec.Meta(gt=0, le=100)] = _USUAL.rate_hz
    deadline_s: Annotated[float, msgspec.Meta(gt=0, le=4)] = _USUAL.deadline_s
    """How long a fused frame waits for the robots. Zenoh closes a transport that is blocked for
    5 s, so it must stay below that."""
    learn: bool = True
    """Whether decisions heed how long answers have taken, and may choose a lower rate; without,
    rate and deadline stay as they are set here."""
    q_min: QMin = Q_MIN
    link_weight: Weight = _USUAL.lambda_link
    """lambda of the objective Q - lambda * C: AP@0.7 that a tenth of the cell must bring."""
    compute_weight: Weight = _USUAL.lambda_compute
    """The same of a tenth of a processor, the ego's or a participant's."""
    cost_weight: Weight = _USUAL.lambda_cost
    """The same of one megabyte a frame, however wide the cell; counts beside the others."""
    comm_range_m: CommRange | None = None
    """How far from the ego a robot may take part; None: what the world's data says, or else what is
    usual with its detector."""
    areas: bool = False
    """Listen to the robots around only, where they say in which cell of the floor they are: on a
    site of more than a few dozen."""
    max_robots: Annotated[int, msgspec.Meta(ge=2, le=100_000)] = MAX_ROBOTS
    """Of whom the newest messages are kept. Each may take as much memory as a scene has bytes, and
    names come from the network."""
    headroom: Headroom = _USUAL.headroom
    link_prior_bps: Annotated[float, msgspec.Meta(ge=1000, le=1e12)] = 55e6
    """C(t) before anything was measured."""
    memory: bool = True
    """Whether objects, and what poses are off by, are followed from frame to frame:
    `Detections.tracks`."""
    rarer: bool = True
    """Whether each robot may be asked for another algorithm, and less often than frames are fused,
    where `memory` carries on what they showed."""
    between: bool = True
    """Whether robots that are asked for points less often than that are asked in between for those
    of the places of what is remembered."""
    max_error_m: Annotated[float, msgspec.Meta(gt=0, le=1)] = 0.1
    """Bound on the position error of points that robots send."""
    keep_ground: bool = False
    """Ask for all points of scans: ground, and all of walls and racks, too."""
    share: bool = True
    """Take what robots publish once for several egos, in place of answers of one's own."""
    llm_period_s: Annotated[float, msgspec.Meta(gt=0, le=3600)] = 5.0
    """Policy `llm` asks at once when the scene or C(t) moves, else this often."""
    llm_deadline_s: Annotated[float, msgspec.Meta(ge=0.05, le=600)] = 20.0
    """How long a question to the language model may take. The cycle does not wait for it."""
    llm_hold_max_s: Annotated[float, msgspec.Meta(gt=0, le=3600)] = 30.0
    """Advice that was adopted longer ago is given up."""
    llm_min_confidence: Annotated[float, msgspec.Meta(ge=0, le=1)] = 0.0
    """Advice that the model itself trusts less is refused."""
    llm_value_margin: Annotated[float, msgspec.Meta(ge=0, le=1)] = 0.005
    """Advice may be predicted to be worse than the fallback by no more than this."""
    llm_judge: Literal["auto", "coverage", "surrogate"] = "auto"
    """Who predicts it: what `coverage` expects, also by `auto`, or the surrogate."""
    llm_prompt: PromptStyle = "table"
    """docs/prompt.md says how they differ."""
    journal: str = ""
    """Path of the journal; empty keeps none."""

    def objective(
        self, usual_range_m: float = COMM_RANGE_M, sensor_hz: float | None = None
    ) -> Objective:
        """What the ego's decisions aim at; `usual_range_m` holds where no range is set. Of a sensor
        with so many scans a second only every n-th can be fused; None: any rate can be kept."""

        def kept(rate_hz: float) -> float:
            return rate_hz if sensor_hz is None else in_step(rate_hz, sensor_hz)

        return Objective(
            lambda_link=self.link_weight,
            lambda_compute=self.compute_weight,
            lambda_cost=self.cost_weight,
            q_min=self.q_min,
            rate_hz=kept(self.fusion_rate_hz),
            deadline_s=self.deadline_s,
            slower_hz=tuple(dict.fromkeys(map(kept, SLOWER_HZ))) if self.learn else (),
            rarer_hz=RARER_HZ if self.rarer and self.memory else (),
            places_hz=PLACES_HZ if self.rarer and self.memory and self.between else 0.0,
            comm_range_m=self.comm_range_m or usual_range_m,
            headroom=self.headroom,
        )


def load_settings(environment: Mapping[str, str] | None = None) -> EgoSettings:
    """The settings from the environment and the TOML file.

    Raises SettingError that names the variable, its value and what is allowed.
    """
    return load(EgoSettings, environment)
