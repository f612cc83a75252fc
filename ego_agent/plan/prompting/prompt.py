"""The question to a language model: what never changes first, what changes fastest last.

Models reuse what they have read of an equal beginning, so each number stands where its pace of
change belongs, rounded to steps that hold for a while. docs/prompt.md explains every line.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from statistics import median
from string import Template

from ego_agent.knowledge.base import CycleResult, Knowledge
from ego_agent.knowledge.model import UnifiedScene
from ego_agent.knowledge.pace import algorithm_of
from ego_agent.plan.choices.scoring import Scorer
from ego_agent.plan.prompting.arrival import arrival_line
from ego_agent.plan.prompting.fingerprint import scene_fingerprint
from ego_agent.plan.prompting.schema import Choice, answer_schema, choices
from ego_agent.plan.prompting.steps import at_most, coarse, percent, place, shown
from ego_agent.plan.prompting.table import STEP_M, Ranked, nameable, ranked, robot_row
from swarm.errors import DecisionError
from swarm.messages import MIXED, Algorithm, ChatMessage, Decision

VERSION = "v1"
"""Of the templates."""
_WORDS = {"early": "raw points", "intermediate": "feature maps", "late": "boxes of objects"}
"""By the first part of an algorithm's name."""


@dataclass(frozen=True, slots=True)
class LlmPrompt:
    """A question, and what is needed to read its answer."""

    messages: tuple[ChatMessage, ...]
    schema: str
    """JSON schema of the answer, as text."""
    fingerprint: str
    """Of the quantised scene, hexadecimal."""
    candidates: tuple[str, ...]
    """Robots that the answer may name, best first; without the ego."""
    ego: str
    letters: bool = False
    """Whether the answer is text that calls them A, B and so on."""
    alone: str = ""
    """The algorithm that such an answer means when it names nobody."""


def make_prompt(
    scene: UnifiedScene,
    knowledge: Knowledge,
    previous: Decision | None,
    result: CycleResult | None,
    *,
    scorer: Scorer | None = None,
) -> LlmPrompt:
    """The question that a scene poses, after a decision and its result.

    `scorer`, if there is one already, must be of the same scene and knowledge. Robots whose ids no
    key may hold are left out. Raises DecisionError for such an ego.
    """
    ego = check_ego(scene)
    scorer = scorer or Scorer(scene, knowledge)
    listed = ranked(scorer)
    robots = tuple(entry.candidate.robot for entry in listed)
    found = choices(scorer, robots)
    return LlmPrompt(
        messages=(
            ChatMessage(role="system", content=_system(scorer)),
            ChatMessage(role="user", content=_user(scorer, listed, found, previous, result)),
        ),
        schema=answer_schema(found, knowledge.best_algorithm()),
        fingerprint=scene_fingerprint(scorer),
        candidates=robots,
        ego=ego,
    )


def check_ego(scene: UnifiedScene) -> str:
    """The ego, whose id must be one that may stand in a prompt. Raises DecisionError."""
    ego = scene.ego.robot
    if not nameable(ego):
        raise DecisionError(f"ego {ego!r} is not allowed: use 1 to 32 letters, digits, '_' or '-'")
    return ego


@cache
def template(name: str) -> Template:
    """The template of that name."""
    folder = files("ego_agent.plan.prompting") / "templates"
    return Template((folder / f"{VERSION}.{name}.txt").read_text("utf-8").rstrip("\n"))


def _system(scorer: Scorer) -> str:
    """The objective and the algorithms: the same for every ego of a swarm, for minutes."""
    objective, knowledge = scorer.objective, scorer.knowledge
    return template("system").substitute(
        base=f"{100 * knowledge.quality.base:.3g}",
        own=f"{knowledge.quality.own:.2f}",
        enough=f"{100 * knowledge.quality.enough:.3g}",
        link=f"{100 * objective.lambda_link:.3g}",
        q_min=f"{100 * objective.q_min:.3g}",
        algorithms="\n".join(_algorithm(knowledge, name) for name in knowledge.algorithms),
        sizes=", ".join(f"{name} = its kB a frame" for name in _costly(knowledge)),
    )


def _algorithm(knowledge: Knowledge, name: Algorithm) -> str:
    paradigm, _, kind = name.partition("-")
    words = [_WORDS.get(paradigm, "a form of its own"), *([kind] if kind else [])]
    compute_s = knowledge.encode_s(name, None) + knowledge.work_s(name)
    points = 100 * knowledge.objective.cost(0.0, 1.0, compute_s, knowledge.objective.rate_hz)
    gain = knowledge.quality.gain(name)
    return f"{name}: {', '.join(words)}, F {gain:.2f}, {shown(coarse(points))} points a helper."


def _cost(scorer: Scorer, name: Algorithm) -> str:
    size = median_size(scorer, name)
    return f"{name} {'-' if size is None else shown(coarse(size / 1e3))}"


def median_size(scorer: Scorer, name: Algorithm) -> float | None:
    """The median of measured sizes, bytes; None where there are none."""
    sizes = [c.sizes[name] for c in scorer.scene.candidates if name in c.sizes]
    return median(sizes) if sizes else None


def _costly(knowledge: Knowledge) -> tuple[Algorithm, ...]:
    """Algorithms whose cost is told robot by robot: all but the last, whose boxes are small."""
    return knowledge.algorithms[:-1] or knowledge.algorithms


def _user(
    scorer: Scorer,
    listed: Sequence[Ranked],
    found: Sequence[Choice],
    previous: Decision | None,
    result: CycleResult | None,
) -> str:
    scene, costs = scorer.scene, _costly(scorer.knowledge)
    others = len(scene.candidates) - len(listed)
    return template("user").substitute(
        ego=scene.ego.robot,
        x=place(scene.ego.pose.x, STEP_M),
        y=place(scene.ego.pose.y, STEP_M),
        share=percent(scorer.share([0])),
        costs=", ".join(_cost(scorer, name) for name in scorer.knowledge.algorithms),
        columns=" ".join(costs),
        rows="\n".join(robot_row(scorer, entry, costs) for entry in listed) or "(nobody)",
        others=f"Not listed: {others} more.",
        before=arrival_line(scorer, listed) + before(scorer, previous, result),
        link=_link(scorer, found),
    )


def before(scorer: Scorer, previous: Decision | None, result: CycleResult | None) -> str:
    """The decision in force and what came of it. Its reason is left out: it is free text."""
    if previous is None or previous.algorithm not in (*scorer.knowledge.algorithms, MIXED):
        return "Before: nothing decided."
    ego = scorer.scene.ego.robot
    helpers = [robot for robot in previous.participants if robot != ego and nameable(robot)]
    sent = [_sent(previous, robot) for robot in helpers[:_MOST_HELPERS]]
    line = f"Before: {previous.algorithm} {' '.join(sent) or 'alone'}"
    if result is not None and result.frames > 0:
        expected = result.predicted_bytes * result.frames
        got = percent(result.received_bytes / expected) if expected else 100
        line += f"; {got} percent arrived, {shown(coarse(result.latency_ms))} ms"
    return line + "."


def _sent(previous: Decision, robot: str) -> str:
    """A helper, with what it sent where the algorithm does not say it."""
    if previous.algorithm != MIXED:
        return robot
    return f"{robot} ({algorithm_of(previous, robot)})"


_MOST_HELPERS = 32


def _link(scorer: Scorer, found: Sequence[Choice]) -> str:
    """What the link carries now: the last line, and the only one that C(t) changes."""
    kilobytes = shown(at_most(scorer.budget_bytes / 1e3))
    helpers = ", ".join(f"{choice.algorithm} {_range(choice)}" for choice in found)
    return f"Link now: {kilobytes} kB a frame. Helpers: {helpers or 'none'}."


def _range(choice: Choice) -> str:
    least, most = choice.at_least, choice.at_most
    return str(most) if least == most else f"{least} to {most}"
