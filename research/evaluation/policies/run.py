"""The comparison: every policy on the same control windows, measured, and written to files."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.compute import ComputeModel, packaged_compute
from ego_agent.plan.policies.base import Policy
from ego_agent.plan.prompting import STYLES
from ego_agent.plan.surrogate.model import packaged_surrogate
from ego_agent.settings import PromptStyle
from perception.fusion.registry import fusion_names
from research.evaluation.policies import advice, as_published
from research.evaluation.policies.advice import AdvisedAtOnce, Model
from research.evaluation.policies.beside import beside_controls
from research.evaluation.policies.claims import claims_of
from research.evaluation.policies.controls import RANDOM_JUDGED, controls
from research.evaluation.policies.decide import Decided, decisions, policy_of
from research.evaluation.policies.figures import Places, draw_figures, need_drawing
from research.evaluation.policies.files import (
    write_compute,
    write_eval,
    write_headline,
    write_selection,
)
from research.evaluation.policies.guessing import RandomJudged
from research.evaluation.policies.report import report
from research.evaluation.policies.results import means_of, rows_of
from research.evaluation.policies.work_items import (
    MADE_FROM,
    Place,
    WorkItem,
    count,
    knowledge_of,
    listen,
    measure,
)
from research.evaluation.published import Summary
from research.evaluation.result_store import ResultStore
from research.evaluation.windows.choice import Choice
from research.evaluation.windows.scenarios import Scenario
from swarm.errors import EvaluationError
from swarm.files import write_whole
from swarm.messages import ALGORITHMS

SURROGATE = "surrogate"


def compare(
    suite: Sequence[Scenario],
    policies: Sequence[str],
    workers: int,
    folder: Path,
    *,
    algorithms: Sequence[str] = ALGORITHMS,
    models: Sequence[str] = (),
    prompts: Sequence[str] = ("table",),
    published: Sequence[Summary] = (),
    compute: ComputeModel | None = None,
) -> None:
    """Compares the policies on the scenarios and writes selection.csv, eval.csv, headline.json,
    report.md, compute.json and the figures into the folder; progress goes to standard error.

    `algorithms`: those that policies decide among, by default the three paradigms as in an ego.
    `models`: language models to ask for advice (evaluation.policies.advice), each with each of the
    `prompts` (ego_agent.plan.prompting.styles). `published` results are drawn beside ours.
    `compute`: what windows are played with, by default the packaged model.

    What is finished is kept in the folder, for a run that goes on after this one was ended; nothing
    is measured before all that was asked for can be done. Raises WorldError for a world that cannot
    be read, DecisionError for an unknown policy, SettingError for a model that cannot be run, and
    EvaluationError when there is nothing to compare.
    """
    if models and RANDOM_JUDGED not in policies:
        policies = (*policies, RANDOM_JUDGED)
    _check(suite, policies, algorithms)
    compute = compute or packaged_compute()
    styles = [_style(name) for name in dict.fromkeys(prompts)]
    kept, answers = (
        ResultStore(folder / "kept", MADE_FROM),
        ResultStore(folder / "kept", advice.MADE_FROM),
    )
    advisers = [Model(spec, answers) for spec in models]
    if len({model.name for model in advisers}) < len(advisers):
        raise EvaluationError(f"two models have one name: {', '.join(m.name for m in advisers)}")
    scenarios = {scenario.name: scenario for scenario in suite}
    names = tuple(algorithms)
    try:
        for model in advisers:
            model.start()
        items = listen(
            [
                WorkItem(one, window, names, compute=compute)
                for one in suite
                for window in range(one.windows)
            ],
            workers,
            kept,
        )
        decided = _decide(
            scenarios, items, policies, [(m, style) for m in advisers for style in styles]
        )
    finally:
        for model in advisers:
            model.close()
    choices: dict[Place, set[Choice]] = {}
    for one in decided:
        choices.setdefault((one.scenario, one.window), set()).add(one.choice)
    items = [replace(item, wanted=tuple(sorted(choices[item.place]))) for item in items]
    measured = measure(items, workers, kept)
    considered = {item.place: known for item, known in zip(items, measured, strict=True)}
    held = count(items, workers, kept)
    rows = rows_of(scenarios, decided, considered, names)
    if not rows:
        raise EvaluationError("no control window of these scenarios holds a true box")
    means = means_of(rows)
    claims = claims_of(means, rows)
    compared = [one.plain() for one in beside_controls(rows)]
    folder.mkdir(parents=True, exist_ok=True)
    write_selection(folder / "selection.csv", rows)
    write_eval(folder / "eval.csv", rows)
    write_headline(
        folder / "headline.json",
        means,
        {
            "claims": claims,
            "controls": compared,
            "bytes_as_published": as_published.plain(rows, held),
        },
    )
    write_whole(folder / "report.md", report(means, claims, rows, held))
    write_compute(folder / "compute.json", compute)
    figures = draw_figures(folder, rows, means, _places(items), held, published)
    files = ["selection.csv", "eval.csv", "headline.json", "report.md", "compute.json", *figures]
    print(f"wrote {', '.join(files)} to {folder}", file=sys.stderr)


def _check(suite: Sequence[Scenario], policies: Sequence[str], algorithms: Sequence[str]) -> None:
    if not suite or not policies or not algorithms:
        raise EvaluationError(
            "there is nothing to compare: no scenario, no policy, or no algorithm"
        )
    available = fusion_names(suite[0].open().detector)
    for name in algorithms:
        if name not in available:
            raise EvaluationError(
                f"algorithm {name!r} is not available; allowed: {', '.join(available)}"
            )
    knowledge = knowledge_of(algorithms, suite[0])
    for name in policies:
        _policy(name, suite[0], knowledge)
    if SURROGATE in policies:
        packaged_surrogate()
    need_drawing()


def _decide(
    scenarios: dict[str, Scenario],
    items: Sequence[WorkItem],
    policies: Sequence[str],
    advisers: Sequence[tuple[Model, PromptStyle]],
) -> list[Decided]:
    """Every policy's decisions in every scenario, and those of its controls."""
    found: list[Decided] = []
    for number, (name, scenario) in enumerate(scenarios.items(), 1):
        own = [item for item in items if item.scenario.name == name]
        heard = [item.heard for item in own if item.heard is not None]
        placed = [item.placed for item in own]
        knowledge = own[0].knowledge()
        everyone: list[Policy] = [_policy(one, scenario, knowledge) for one in policies]
        everyone += [AdvisedAtOnce(model, style) for model, style in advisers]
        for policy in everyone:
            chosen = decisions(scenario, heard, knowledge, policy, placed)
            found += chosen
            found += controls(scenario, heard, knowledge, chosen, placed)
        if advisers:
            print(f"advised: {number}/{len(scenarios)} scenarios", file=sys.stderr, flush=True)
    return found


def _style(name: str) -> PromptStyle:
    for style in STYLES:
        if style == name:
            return style
    raise EvaluationError(f"prompt {name!r} is not known; allowed: {', '.join(STYLES)}")


def _policy(name: str, scenario: Scenario, knowledge: Knowledge) -> Policy:
    """A new policy of that name, or the control of language models; raises as `policy_of` does."""
    if name == RANDOM_JUDGED:
        return RandomJudged(scenario.seed)
    return policy_of(name, scenario, knowledge)


def _places(items: Sequence[WorkItem]) -> Places:
    """Where robots said that they were, from where the ego was."""
    found = {}
    for item in items:
        poses = {robot: beacon.pose for robot, (beacon, _) in (item.heard or {}).items()}
        x, y = list(poses.values())[item.scenario.ego][:2]
        found[item.place] = {robot: (pose[0] - x, pose[1] - y) for robot, pose in poses.items()}
    return found
