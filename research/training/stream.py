"""The stream of training batches. Each follows from the plan's seed and its step alone, so that a
resumed run is shown what it would have been shown."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import DataLoader, IterableDataset, get_worker_info

from perception.detector.grid import BevConfig
from research.training.plans import Plan
from research.training.samples import Sample, draw
from research.training.targets import Targets, make_targets


@dataclass(frozen=True, slots=True)
class Batch:
    """What one step is shown."""

    step: int
    clouds: list[Tensor]
    """float32 (N, 3) each, sample by sample, the ego's first."""
    counts: list[int]
    """Clouds of each sample."""
    fused: Targets
    """Of each sample."""
    views: Targets
    """Of each cloud by itself."""


class Stream(IterableDataset[Batch]):
    """Batches from one step on."""

    def __init__(self, plan: Plan, begin: int) -> None:
        self._plan = plan
        self._begin = begin

    def __iter__(self) -> Iterator[Batch]:
        info = get_worker_info()
        first, stride = (info.id, info.num_workers) if info else (0, 1)
        for step in range(self._begin + first, self._plan.steps, stride):
            yield make_batch(self._plan, step)


def make_batch(plan: Plan, step: int) -> Batch:
    """The batch of one step."""
    config = plan.shown()
    samples = []
    for number in range(plan.batch):
        rng = np.random.default_rng([plan.seed, step, number])
        if number % plan.samples_of_world == 0:
            world = plan.world(rng)
        samples.append(draw(world, rng, plan.reach_m, plan.aside_m))
    return Batch(
        step=step,
        clouds=[torch.from_numpy(cloud) for sample in samples for cloud in sample.clouds],
        counts=[len(sample.clouds) for sample in samples],
        fused=make_targets(
            config, [s.boxes for s in samples], [s.hits.sum(axis=0) for s in samples]
        ),
        views=_views(config, samples),
    )


def batches(plan: Plan, begin: int, workers: int) -> Iterator[Batch]:
    """Batches made by worker processes, in order; by this process where there are none."""
    loader = DataLoader(
        Stream(plan, begin),
        batch_size=None,
        num_workers=workers,
        prefetch_factor=4 if workers else None,
        worker_init_fn=_leave_signals,
    )
    return iter(loader)


def _leave_signals(worker: int) -> None:
    """A terminal interrupts all processes; the run itself ends its workers, after its last step."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)


def _views(config: BevConfig, samples: list[Sample]) -> Targets:
    boxes = [sample.boxes for sample in samples for _ in sample.clouds]
    hits = [seen for sample in samples for seen in sample.hits]
    return make_targets(config, boxes, hits)
