"""A small network that learns decisions from the numbers of the short prompt: the control of
language models that learn them from its text.

It gives each answer that is allowed a score, from what the prompt says of it; the best one is its
choice. Learning takes seconds.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from ego_agent.plan.prompting.short import ShortScene
from swarm.messages import ALGORITHMS, Algorithm

Option = tuple[Algorithm, int]
WIDTH = 40
EPOCHS = 120
BATCH = 64
RATE = 3e-3


def features(short: ShortScene) -> NDArray[np.float32]:
    """Of each option what the prompt tells, float32 (options, features), in [0, 1] mostly."""
    return np.array([_of(short, name, helpers) for name, helpers in short.options], np.float32)


def _of(short: ShortScene, name: Algorithm, helpers: int) -> list[float]:
    seen = [percent / 100 for percent in short.seen]
    adds = [*(percent / 100 for percent in short.adds), 0.0]
    fast, _ = short.fits[name]
    taken_kb = short.kilobytes[name][helpers - 1] if helpers else 0.0
    price = min(1.0, short.price[name] / 100)
    return [
        *(float(name == one) for one in ALGORITHMS),
        float(helpers == 0),
        helpers / 8,
        seen[0],
        seen[helpers],
        adds[helpers - 1] if helpers else 1.0,
        adds[helpers],
        price,
        price * helpers,
        min(2.0, taken_kb / max(1e-3, short.budget_kb)),
        float(helpers <= fast),
        short.in_time[name] / 100,
        float(short.within_reach),
    ]


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

    def choose(self, short: ShortScene) -> Option:
        """The option with the best score."""
        with torch.no_grad():
            scores = self(torch.from_numpy(features(short)))
        return short.options[int(scores.argmax())]


def learn(taught: Sequence[tuple[ShortScene, Option]], seed: int) -> Chooser:
    """A network that has seen these scenes and answers EPOCHS times. Equal seeds learn alike."""
    torch.manual_seed(seed)
    tables = [features(short) for short, _ in taught]
    answers = [short.options.index(option) for short, option in taught]
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
