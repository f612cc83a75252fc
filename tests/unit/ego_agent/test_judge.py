"""Who predicts what advice would bring: what `coverage` counts, or the surrogate."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ego_agent.plan.advice.judge import Advised, Verdict, judge
from ego_agent.plan.choices.scoring import Scorer
from ego_agent.plan.policies import llm, surrogate
from ego_agent.plan.policies.llm import Llm
from ego_agent.plan.policies.surrogate import BySurrogate
from ego_agent.plan.surrogate.features import NAMES
from ego_agent.plan.surrogate.model import Surrogate, read_surrogate
from ego_agent.settings import EgoSettings
from swarm.errors import DecisionError
from tests.support.ego_advice import floor
from tests.support.ego_scenes import knowledge

MARGIN = EgoSettings().llm_value_margin


def fond_of(algorithm: str, *others: str) -> Surrogate:
    """Expects AP@0.7 of 0.95 with one algorithm and of 0.05 with any other."""
    algorithms = (algorithm, *others)
    first = np.zeros((1, len(NAMES) + len(algorithms)), np.float32)
    first[0, len(NAMES)] = 1.0
    one, six, zero = np.ones((1, 1), np.float32), np.full((1, 1), 6, np.float32), np.zeros(1)
    none = zero.astype(np.float32)
    return Surrogate(algorithms, (first, one, six), (none, none, none - 3), {})


def verdict(algorithm: str, model: Surrogate | None) -> Verdict:
    """On A and B with an algorithm, where the fallback has both with early fusion."""
    scorer = Scorer(floor(), knowledge(("early", "late")))
    fallback = scorer.score(["A", "B"], "early")
    advice = Advised(["A", "B"], algorithm)
    return judge(advice, scorer, fallback, margin=MARGIN, surrogate=model)


def test_the_surrogate_predicts_in_place_of_coverage() -> None:
    assert verdict("late", None).refused == "worse", "late has the lower quality factor"
    assert verdict("late", fond_of("late", "early")).refused is None
    against = verdict("late", fond_of("early", "late"))
    assert against.refused == "worse"
    assert "predicted quality 0.0" in against.why


def test_it_is_not_asked_about_algorithms_that_it_has_not_learnt() -> None:
    assert verdict("late", fond_of("late")) == verdict("late", None)
    assert verdict("early", fond_of("late")).refused is None


@pytest.mark.parametrize(
    ("settings", "asked"),
    [
        (EgoSettings(), False),
        (EgoSettings(world="opv2v", llm_judge="surrogate"), True),
        (EgoSettings(llm_judge="coverage"), False),
    ],
)
def test_it_is_asked_where_it_is_wanted(
    settings: EgoSettings, asked: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(llm, "packaged_surrogate", lambda: read_surrogate(tmp_path / "none"))
    policy = Llm()
    if not asked:
        policy.prepare(settings)
        return
    with pytest.raises(DecisionError, match="there is no surrogate"):
        policy.prepare(settings)


def test_a_policy_without_its_surrogate_says_so_before_the_first_cycle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(surrogate, "packaged_surrogate", lambda: read_surrogate(tmp_path / "none"))
    with pytest.raises(DecisionError, match="there is no surrogate"):
        BySurrogate().prepare(EgoSettings())
