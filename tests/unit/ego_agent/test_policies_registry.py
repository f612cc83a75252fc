from __future__ import annotations

from pathlib import Path

import pytest

from ego_agent.plan import policies
from ego_agent.plan.policies.registry import make_policy, policy_names
from swarm.errors import DecisionError
from tests.support.ego_scenes import candidate, knowledge, scene

THIRD_PARTY = """
from ego_agent.knowledge.model import Proposal

class Farthest:
    name = "farthest"

    def propose(self, scene, knowledge, previous):
        return Proposal((scene.candidates[-1].robot,), "late", "far", "policy")

POLICIES = (Farthest,)
"""


def test_the_policies_of_the_product_are_there() -> None:
    assert {"coverage", "rules", "static-early", "static-intermediate", "static-late"} <= set(
        policy_names()
    )


def test_an_unknown_policy_is_refused_with_the_names_that_are_allowed() -> None:
    with pytest.raises(
        DecisionError, match=r"'clever' is unknown; allowed: coverage, llm, random, rules, "
    ):
        make_policy("clever", ["early"])


@pytest.mark.parametrize("name", ["early", "intermediate", "late"])
def test_a_static_policy_needs_its_algorithm(name: str) -> None:
    others = [a for a in ("early", "intermediate", "late") if a != name]
    with pytest.raises(DecisionError, match=f"needs {name} fusion.*available: {others[0]}"):
        make_policy(f"static-{name}", others)
    assert make_policy(f"static-{name}", [name, *others]).name == f"static-{name}"


def test_one_new_file_is_a_new_policy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "farthest_for_test.py").write_text(THIRD_PARTY)
    monkeypatch.setattr(policies, "__path__", [*policies.__path__, str(tmp_path)])
    policy = make_policy("farthest", ["late"])
    assert "farthest" in policy_names()
    found = policy.propose(scene(candidate("E"), candidate("A"), candidate("B")), knowledge(), None)
    assert found.participants == ("B",)


def test_two_policies_of_one_name_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = THIRD_PARTY.replace('"farthest"', '"coverage"')
    (tmp_path / "usurper_for_test.py").write_text(text)
    monkeypatch.setattr(policies, "__path__", [*policies.__path__, str(tmp_path)])
    with pytest.raises(DecisionError, match="two policies are called 'coverage'"):
        policy_names()
