"""Short prompts and the answers that `coverage` would give to them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import NamedTuple

from ego_agent.knowledge.base import Knowledge
from ego_agent.knowledge.model import UnifiedScene
from ego_agent.plan.choices.scoring import Score, Scorer
from ego_agent.plan.policies.coverage import Coverage
from ego_agent.plan.prompting.letters import short_answer
from ego_agent.plan.prompting.short import ShortScene, short_scene, short_text
from research.training.decisions.scenes import TRAINING, Split, known, scene_groups
from swarm.messages import Algorithm


class Example(NamedTuple):
    """A question of the short prompt, behind its system message, and its answer."""

    prompt: str
    answer: str
    """As the schema has it: JSON text, quotes included."""


def examples(seed: int, split: Split = TRAINING) -> Iterator[Example]:
    """Without end, all links of a scene one after the other; equal seeds give equal ones."""
    knowledge = known()
    for group in scene_groups(split, seed):
        for scene in group:
            short, option, _ = taught(scene, knowledge)
            yield Example(short_text(short), json.dumps(short_answer(*option)))


def taught(
    scene: UnifiedScene, knowledge: Knowledge
) -> tuple[ShortScene, tuple[Algorithm, int], Score]:
    """A scene in short, what `coverage` would answer, and what it decides itself where nothing was
    decided before. Where no answer says that, the last of those that come nearest to its set."""
    scorer = Scorer(scene, knowledge)
    decided, _ = Coverage().choose(scorer, None)
    short = short_scene(scorer)
    wanted = set(decided.participants)

    def apart(option: tuple[Algorithm, int]) -> tuple[bool, int]:
        name, helpers = option
        return bool(wanted) and name != decided.algorithm, len(wanted ^ set(short.robots[:helpers]))

    return short, min(short.options, key=apart), decided
