"""The training loop: resumable at any step, with its progress on standard error."""

from __future__ import annotations

import signal
import sys
import time
from collections import deque
from pathlib import Path
from types import FrameType

import torch

from perception.detector.network import Network
from perception.detector.weights import save_weights
from research.training.codes import codebook_of
from research.training.learn import losses, rate_at
from research.training.plans import Plan
from research.training.state import Curve, load, optimiser_tensors, restore_optimiser, save
from research.training.stream import batches
from swarm.errors import PerceptionError

SAVE_EVERY = 200
SHOW_EVERY = 25
AVERAGED = 0.998
"""Decay of the averaged weights, which are the ones that are kept."""
MAX_GRADIENT = 10.0


class Run:
    """One run in a folder: `state.safetensors`, `curve.jsonl`, at the end `weights.safetensors`.

    Raises PerceptionError when the folder holds a run of another plan.
    """

    def __init__(self, plan: Plan, folder: Path, device: str = "cpu") -> None:
        self._plan = plan
        self._folder = folder
        self._config = plan.shown()
        torch.manual_seed(plan.seed)
        self._network = Network(self._config).to(device)
        self._network = self._network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self._optimiser = torch.optim.AdamW(
            self._network.parameters(), lr=plan.rate, weight_decay=0.01
        )
        self._averaged = {k: v.detach().clone() for k, v in self._network.state_dict().items()}
        self._stopping = False
        self.step = 0
        folder.mkdir(parents=True, exist_ok=True)
        if self._state.exists():
            self._resume()

    @property
    def _state(self) -> Path:
        return self._folder / "state.safetensors"

    @property
    def weights(self) -> Path:
        """Where the finished weights are."""
        return self._folder / "weights.safetensors"

    def train(self, workers: int) -> bool:
        """Trains to the end of the plan, or until the process is asked to stop; returns whether it
        was the end."""
        curve = Curve(self._folder / "curve.jsonl", self.step)
        before = [signal.signal(s, self._stop) for s in (signal.SIGINT, signal.SIGTERM)]
        recent: deque[float] = deque(maxlen=200)
        try:
            self._network.train()
            for batch in batches(self._plan, self.step, workers):
                begun = time.monotonic()
                parts = self._learn(
                    batch.step, losses(self._network, self._config, batch, self._plan.seed)
                )
                self.step = batch.step + 1
                recent.append(time.monotonic() - begun)
                if self.step % SHOW_EVERY == 0:
                    curve.add(step=self.step, **parts)
                    self._show(parts, sum(recent) / len(recent))
                if self._stopping or self.step % SAVE_EVERY == 0:
                    self._save()
                if self._stopping:
                    return False
        finally:
            for number, handler in zip((signal.SIGINT, signal.SIGTERM), before, strict=True):
                signal.signal(number, handler)
        self._save()
        codebook = codebook_of(self._plan, self._averaged)
        save_weights(self.weights, self._plan.config, self._averaged, codebook, self._facts())
        return True

    def _learn(self, step: int, parts: dict[str, torch.Tensor]) -> dict[str, float]:
        for group in self._optimiser.param_groups:
            group["lr"] = rate_at(self._plan, step)
        self._optimiser.zero_grad(set_to_none=True)
        parts["total"].backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(self._network.parameters(), MAX_GRADIENT)
        self._optimiser.step()
        # Early on the average must follow quickly.
        keep = min(AVERAGED, (1 + step) / (10 + step))
        for name, value in self._network.state_dict().items():
            mean = self._averaged[name]
            if value.dtype.is_floating_point:
                mean.lerp_(value.detach(), 1.0 - keep)
            else:
                mean.copy_(value)
        told = {name: float(value.detach()) for name, value in parts.items()}
        if not all(map(_finite, told.values())):
            raise PerceptionError(f"the loss of step {step} is not finite: {told}")
        return told

    def _save(self) -> None:
        parts = {
            "network": self._network.state_dict(),
            "averaged": self._averaged,
            "optimiser": optimiser_tensors(self._optimiser),
        }
        save(self._state, self.step, parts, self._facts())

    def _resume(self) -> None:
        step, parts, facts = load(self._state)
        if facts != self._facts():
            raise PerceptionError(
                f"{self._state} is a run of {facts}, not of {self._facts()}; remove it to begin"
            )
        self._network.load_state_dict(parts["network"])
        self._averaged = {k: v.to(self._averaged[k].device) for k, v in parts["averaged"].items()}
        restore_optimiser(self._optimiser, parts["optimiser"])
        self.step = step

    def _facts(self) -> dict[str, str]:
        plan = self._plan
        return {
            "config": plan.config, "steps": str(plan.steps), "batch": str(plan.batch),
            "rate": str(plan.rate), "seed": str(plan.seed), "reach_m": str(plan.reach_m),
            "part_x_m": str(plan.part_x_m),
        }  # fmt: skip

    def _show(self, parts: dict[str, float], step_s: float) -> None:
        left = (self._plan.steps - self.step) * step_s / 60
        shown = " ".join(f"{name} {value:.3f}" for name, value in parts.items())
        print(
            f"step {self.step}/{self._plan.steps} {shown}, {step_s:.2f} s a step, "
            f"{left:.0f} min left",
            file=sys.stderr,
            flush=True,
        )

    def _stop(self, number: int, frame: FrameType | None) -> None:
        self._stopping = True


def _finite(value: float) -> bool:
    return value == value and abs(value) != float("inf")
