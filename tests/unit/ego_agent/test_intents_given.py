"""An ego is given intents, keeps them across restarts, and ends them."""

from __future__ import annotations

import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import Proposal, UnifiedScene
from ego_agent.knowledge.objective import Objective
from ego_agent.plan.intents.combine import Standing
from ego_agent.plan.intents.given import Intents
from ego_agent.plan.policies.registry import make_policy
from ego_agent.replay import LastMinute
from ego_agent.settings import EgoSettings
from ego_agent.steering import NobodyLeftError, Steering
from swarm.errors import DecisionError
from swarm.log import make_logger
from swarm.messages import (
    MIXED,
    Assignment,
    Decision,
    EgoSteered,
    EgoSteering,
    EgoWish,
    Focus,
    Intent,
    Place,
)
from swarm.messages.obeyed import MAX_INTENTS
from swarm.messages.steer import IntentAct
from tests.support.ego_scenes import BOTH, snapshot, view

LOG = make_logger("ego")
DOCKS = Place("docks", ((0, 0), (10, 0), (10, 10)))


def steering(tmp_path: Path, *, last_minute: bool = True) -> Steering:
    settings = EgoSettings(ego="E", journal=str(tmp_path / "journal.jsonl"))
    known = Knowledge(Objective(), BOTH)
    made = Steering(settings, make_policy("coverage", BOTH), known, LOG)
    if last_minute:
        views = (view("E"), view("A", 12.0), view("B", 0.0, 14.0))
        made.minute.note(snapshot(*views), time.monotonic())
    return made


def ask(
    made: Steering, act: IntentAct, intent: Intent | None = None, number: int = 0
) -> EgoSteered:
    request = EgoSteering(
        operator="ann",
        wish=EgoWish(),
        act=act,
        intent=intent,
        said="please",
        places=(DOCKS,),
        number=number,
    )
    return made.steer(request)


def test_what_is_tried_tells_its_effect_and_changes_nothing(tmp_path: Path) -> None:
    made = steering(tmp_path)
    reply = ask(made, "try", Intent(exclude=("A",), focus=(Focus("docks"),)))
    assert (reply.intents, reply.number) == ((), 0)
    effect = reply.effect
    assert effect is not None
    assert effect.before is not None
    assert effect.after is not None
    assert (effect.decisions, effect.nobody) == (1, False)
    assert "A" in effect.before.robots
    assert "A" not in effect.after.robots
    assert effect.after.quality < effect.before.quality
    assert effect.after.bytes_s < effect.before.bytes_s
    assert set(effect.after.seen) == {"docks"}


class Mixing:
    """A sends points in every frame, B boxes twice a second."""

    name = "mixing"

    def propose(
        self, scene: UnifiedScene, knowledge: Knowledge, previous: Decision | None
    ) -> Proposal:
        chosen = (
            Assignment(robot="A", algorithm="early", rate_hz=10.0),
            Assignment(robot="B", algorithm="late", rate_hz=2.0),
        )
        return Proposal(("E", "A", "B"), MIXED, "as told", "policy", assignments=chosen)


def test_the_effect_of_decisions_in_which_robots_send_different_things_is_told() -> None:
    objective = Objective(rarer_hz=(2.0,), q_min=0.1)
    known = Knowledge(objective, ("early", "late"), mixable=("early", "late"))
    sizes = {"early": 40_000, "late": 1_000}
    views = (view("E"), view("A", 12.0, sizes=sizes), view("B", 0.0, 14.0, sizes=sizes))
    minute = LastMinute()
    minute.note(snapshot(*views), time.monotonic())
    mixing = (Standing(), Mixing())
    effect = minute.effect(known, objective, mixing, mixing, time.monotonic())
    assert effect.after is not None
    assert effect.after == effect.before
    assert effect.after.robots == {"A": 1.0, "B": 1.0}
    assert effect.after.bytes_s == pytest.approx(10 * 40_000 + 2 * 1_000, rel=0.01)
    assert effect.after.quality > 0.0


def test_what_is_confirmed_is_obeyed_kept_and_withdrawn(tmp_path: Path) -> None:
    made = steering(tmp_path)
    reply = ask(made, "confirm", Intent(exclude=("A",), q_min=0.9, policy="rules"))
    assert reply.number == 1
    (one,) = reply.intents
    assert (one.operator, one.wish, one.places) == ("ann", "please", ())

    again = steering(tmp_path)  # the ego's next process
    known = Knowledge(Objective(), BOTH)
    policy, wishes = again.take(known)
    assert (policy.name, known.objective.q_min) == ("rules", 0.9)
    assert set(wishes.exclude) == {"A"}
    assert ask(again, "withdraw", number=1).intents == ()
    policy, wishes = again.take(known)
    assert (policy.name, known.objective.q_min) == ("coverage", Objective().q_min)
    assert not wishes.intents
    assert steering(tmp_path).intents.all() == ()
    assert ask(again, "confirm", Intent(q_min=0.7)).number == 2


def test_the_standby_keeps_an_intent_under_the_number_of_the_first_ego(tmp_path: Path) -> None:
    made = steering(tmp_path)
    assert ask(made, "confirm", Intent(q_min=0.7), number=5).number == 5
    assert ask(made, "confirm", Intent(q_min=0.8), number=5).number == 5
    assert [one.intent.q_min for one in made.intents.all()] == [0.8]
    assert ask(made, "confirm", Intent(q_min=0.9)).number == 6


@pytest.mark.parametrize("intent", [Intent(only=()), Intent(exclude=("A", "B"))])
def test_an_intent_that_leaves_nobody_needs_a_second_confirmation(
    tmp_path: Path, intent: Intent
) -> None:
    made = steering(tmp_path)
    assert ask(made, "try", intent).effect is not None
    with pytest.raises(NobodyLeftError, match="nobody to ask") as refused:
        ask(made, "confirm", intent)
    assert refused.value.code == "nobody"
    assert made.intents.all() == ()
    assert ask(made, "confirm-nobody", intent).number == 1


def test_without_a_last_minute_the_effect_is_not_known(tmp_path: Path) -> None:
    reply = ask(steering(tmp_path, last_minute=False), "confirm", Intent(exclude=("A",)))
    assert reply.effect is not None
    assert (reply.effect.decisions, reply.effect.after) == (0, None)
    assert reply.number == 1


OVER = (datetime.now(UTC) - timedelta(seconds=1)).isoformat()


@pytest.mark.parametrize(
    ("intent", "named"),
    [
        (None, "wishes nothing"),
        (Intent(unclear=("hello?",)), "wishes nothing"),
        (Intent(exclude=("E",)), "ego's own"),
        (Intent(exclude=("A",), only=("A",)), "'A' is both"),
        (Intent(focus=(Focus("hall"),)), "'hall' has no polygon; drawn: docks"),
        (Intent(policy="dice"), "'dice' is unknown"),
        (Intent(policy="static-intermediate"), "not available"),
        (Intent(q_min=0.5, until=OVER), "is over"),
    ],
)
def test_what_cannot_be_obeyed_is_refused(
    tmp_path: Path, intent: Intent | None, named: str
) -> None:
    made = steering(tmp_path)
    for act in ("try", "confirm"):
        with pytest.raises(DecisionError, match=named):
            ask(made, "try" if act == "try" else "confirm", intent)
    assert made.intents.all() == ()


def test_what_is_not_in_force_cannot_be_withdrawn(tmp_path: Path) -> None:
    with pytest.raises(DecisionError, match="no wish 3 is in force or waiting; there are: none"):
        ask(steering(tmp_path), "withdraw", number=3)


def test_one_intent_too_many_is_refused(tmp_path: Path) -> None:
    made = steering(tmp_path, last_minute=False)
    for _ in range(MAX_INTENTS):
        ask(made, "confirm", Intent(q_min=0.5))
    with pytest.raises(DecisionError, match="withdraw one first"):
        ask(made, "confirm", Intent(q_min=0.5))


def test_an_intent_ends_by_itself_and_is_forgotten(tmp_path: Path) -> None:
    made = steering(tmp_path)
    until = datetime.now(UTC) + timedelta(hours=1)
    ask(made, "confirm", Intent(exclude=("A",), until=until.isoformat()))
    end_ns = int(until.timestamp() * 1e9)
    assert made.intents.standing(end_ns - 10**9).intents
    assert not made.intents.standing(end_ns + 10**9).intents
    assert made.intents.all() == ()
    assert steering(tmp_path).intents.all() == ()


def test_an_intent_waits_for_its_start(tmp_path: Path) -> None:
    made = steering(tmp_path)
    start = datetime.now(UTC) + timedelta(hours=1)
    assert len(ask(made, "confirm", Intent(q_min=0.9, start=start.isoformat())).intents) == 1
    _, wishes = made.take(Knowledge(Objective(), BOTH))
    assert not wishes.intents
    assert made.intents.standing(int(start.timestamp() * 1e9) + 10**9).intents


@pytest.mark.parametrize("content", [b"", b"{", b"\xff", b'{"intents": [{"number": 1}]}'])
def test_a_file_that_cannot_be_read_does_not_stop_the_ego(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "intents"
    path.write_bytes(content)
    assert Intents("E", path, LOG).all() == ()
    assert path.read_bytes() == content


def test_an_intent_that_cannot_be_kept_is_refused(tmp_path: Path) -> None:
    made = steering(tmp_path / "missing")
    with pytest.raises(DecisionError, match="cannot be kept"):
        ask(made, "confirm", Intent(q_min=0.9))
    assert made.intents.all() == ()
