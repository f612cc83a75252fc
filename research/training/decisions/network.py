"""A small network that learns decisions from the numbers of the short prompt: the control of
language models that learn them from its text.

It gives each answer that is allowed a score, from what the prompt says of it; the best one is its
choice. Learning takes seconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from ego_agent.plan.prompting.letters import Groups, helpers
from ego_agent.plan.prompting.short import ShortScene
from swarm.messages import ALGORITHMS, Algorithm

WIDTH = 40
EPOCHS = 120
BATCH = 64
RATE = 3e-3


class Lesson(NamedTuple):
    """A scene, what may be answered, and what is to be."""

    short: ShortScene
    options: Sequence[Groups]
    answer: Groups


def features(short: ShortScene, options: Sequence[Groups]) -> NDArray[np.float32]:
    """Of each option what the prompt tells, float32 (options, features), in [0, 1] mostly."""
    return np.array([_of(short, groups) for groups in options], np.float32)


def _of(short: ShortScene, groups: Groups) -> list[float]:
    count = helpers(groups)
    seen = [percent / 100 for percent in short.seen]
    adds = [*(percent / 100 for percent in short.adds), 0.0]
    found = [
        float(count == 0), count / 8, seen[0], seen[count], adds[count],
        float(len(groups) > 1), float(short.within_reach),
    ]  # fmt: skip
    ends, at = {}, 0
    for name, number in groups:
        ends[name] = at, at + number
        at += number
    taken_kb = 0.0
    for name in ALGORITHMS:
        start, end = ends.get(name, (0, 0))
        taken_kb += _kilobytes(short, name, start, end)
        price = min(1.0, short.price.get(name, 0.0) / 100)
        fast, slow = short.fits.get(name, (0, 0))
        found += [
            (end - start) / 8,
            seen[end] - seen[start],
            adds[end - 1] if end else 0.0,
            adds[end],
            price,
            price * (end - start),
            float(end <= fast),
            (slow - end) / 8,
            short.in_time.get(name, 0) / 100,
        ]
    return [*found, min(2.0, taken_kb / max(1e-3, short.budget_kb))]


def _kilobytes(short: ShortScene, name: Algorithm, start: int, end: int) -> float:
    """Of the robots between two letters."""
    total = [0.0, *short.kilobytes.get(name, ())]
    return total[min(end, len(total) - 1)] - total[min(start, len(total) - 1)]


class Chooser(nn.Module):
    """Scores of options, from their features."""

    def __init__(self, inputs: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Linear(inputs, WIDTH), nn.ReLU(), nn.Linear(WIDTH, WIDTH), nn.ReLU(),
            nn.Linear(WIDTH, 1),
        )  # fmt: skip

    def forward(self, options: torch.Tensor) -> torch.Tensor:
        """float32 (..., features) to (...)."""
        scores: torch.Tensor = self.layers(options)[..., 0]
        return scores

    @property
    def parameter_count(self) -> int:
        """Numbers that are learnt."""
        return sum(parameter.numel() for parameter in self.parameters())

    def choose(self, short: ShortScene, options: Sequence[Groups]) -> Groups:
        """The option with the best score."""
        with torch.no_grad():
            scores = self(torch.from_numpy(features(short, options)))
        return options[int(scores.argmax())]


def learn(lessons: Sequence[Lesson], seed: int) -> Chooser:
    """A network that has seen these lessons EPOCHS times. Equal seeds learn alike."""
    torch.manual_seed(seed)
    tables = [features(one.short, one.options) for one in lessons]
    answers = [one.options.index(one.answer) for one in lessons]
    most = max(map(len, tables))
    inputs = torch.zeros(len(tables), most, tables[0].shape[1])
    absent = torch.ones(len(tables), most, dtype=torch.bool)
    for row, table in enumerate(tables):
        inputs[row, : len(table)] = torch.from_numpy(table)
        absent[row, : len(table)] = False
    wanted = torch.tensor(answers)
    chooser = Chooser(inputs.shape[2])
    optimizer = torch.optim.Adam(chooser.parameters(), lr=RATE)
    steps = EPOCHS * (len(tables) // BATCH + 1)
    fading = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    for _ in range(steps):
        drawn = torch.randint(len(tables), (BATCH,))
        scores = chooser(inputs[drawn]).masked_fill(absent[drawn], -1e9)
        loss = nn.functional.cross_entropy(scores, wanted[drawn])
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        fading.step()
    return chooser
