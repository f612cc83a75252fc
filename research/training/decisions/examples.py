"""Short prompts and the answers that `coverage` would give to them."""

from __future__ import annotations

import json
import multiprocessing
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from itertools import islice
from typing import NamedTuple

from ego_agent.plan.choices.scoring import Score, Scorer
from ego_agent.plan.policies.coverage import Coverage
from ego_agent.plan.prompting.letters import Groups, short_answer
from ego_agent.plan.prompting.short import ShortScene, groups_of, short_scene, short_text
from research.training.decisions.scenes import TRAINING, Split, known, scene_groups

SHARDS = 8
"""Parts in which many examples are made."""


class Example(NamedTuple):
    """A question of the short prompt, behind its system message, and its answer."""

    prompt: str
    answer: str
    """As the schema has it: JSON text, quotes included."""


def examples(seed: int, split: Split = TRAINING) -> Iterator[Example]:
    """Without end, all links of a scene one after the other, without those where no answer says
    what `coverage` decides; equal seeds give equal ones."""
    knowledge = known()
    for group in scene_groups(split, seed):
        for scene in group:
            short, groups, _ = taught(Scorer(scene, knowledge))
            if groups is not None:
                yield Example(short_text(short), json.dumps(short_answer(groups)))


def many(seed: int, count: int, processes: int) -> list[Example]:
    """So many examples, made by so many processes; how many they are changes nothing."""
    each, left = divmod(count, SHARDS)
    sizes = [each + (number < left) for number in range(SHARDS)]
    seeds = [seed * 1000 + number for number in range(SHARDS)]
    # Forking a process in which PyTorch has run is not safe.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, context) as pool:
        return [one for part in pool.map(_first, seeds, sizes) for one in part]


def _first(seed: int, count: int) -> list[Example]:
    return list(islice(examples(seed), count))


def taught(scorer: Scorer) -> tuple[ShortScene, Groups | None, Score]:
    """A scene in short, what `coverage` would answer, and what it decides itself where nothing was
    decided before. None where no answer says that."""
    decided, _ = Coverage().choose(scorer, None)
    short = short_scene(scorer)
    return short, groups_of(short, decided), decided
