"""A state dict from a file, with no code in it ever run, into a network whose parts it must fit."""

from __future__ import annotations

import pickle
import re
from collections.abc import Mapping
from pathlib import Path

import torch
from torch import Tensor, nn

from swarm.errors import PerceptionError

LATEST = "latest.pth"
_NAME = re.compile(r"net_epoch(_bestval_at)?(\d+)\.pth")
_SHOWN = 3


def find_checkpoint(directory: Path, epoch: int | None = None) -> Path:
    """The checkpoint of an epoch; without one: the latest, the best on validation, or the last.

    Raises PerceptionError when there is none.
    """
    ranked = []
    for path in Path(directory).glob("*.pth"):
        named = _NAME.fullmatch(path.name)
        if named and epoch in (None, int(named[2])):
            ranked.append((0, bool(named[1]), int(named[2]), path))
        elif path.name == LATEST and epoch is None:
            ranked.append((1, False, 0, path))
    if not ranked:
        wanted = "*" if epoch is None else str(epoch)
        raise PerceptionError(
            f"{directory} has no checkpoint; needed: net_epoch{wanted}.pth or "
            f"net_epoch_bestval_at{wanted}.pth{f' or {LATEST}' if epoch is None else ''}"
        )
    return max(ranked)[-1]


def load_into(network: nn.Module, path: Path) -> None:
    """Fills the network from the file.

    Raises PerceptionError when the file is no checkpoint, holds anything but tensors (a pickle that
    would run code is refused, not run), or does not fit, naming the first keys that do not.
    """
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
    except pickle.UnpicklingError as error:
        raise PerceptionError(
            f"checkpoint {path} holds more than tensors or is damaged, and is refused: "
            f"{_first_line(error)}"
        ) from error
    except (OSError, RuntimeError, EOFError, ValueError, LookupError, TypeError) as error:
        raise PerceptionError(
            f"checkpoint {path} cannot be read: {type(error).__name__}: {_first_line(error)}"
        ) from error
    if not isinstance(state, Mapping) or not all(isinstance(v, Tensor) for v in state.values()):
        raise PerceptionError(f"checkpoint {path} is no state dict: names with a tensor each")
    problems = _misfits(network.state_dict(), state)
    if problems:
        more = f", and {len(problems) - _SHOWN} more" if len(problems) > _SHOWN else ""
        raise PerceptionError(
            f"checkpoint {path} does not fit its config.yaml: {'; '.join(problems[:_SHOWN])}{more}"
        )
    network.load_state_dict(dict(state))


def _misfits(wanted: Mapping[str, Tensor], found: Mapping[str, Tensor]) -> list[str]:
    problems = [f"{name} is missing" for name in wanted if name not in found]
    problems += [f"{name} is not expected" for name in found if name not in wanted]
    for name in wanted:
        if name not in found:
            continue
        if found[name].shape != wanted[name].shape:
            shapes = (tuple(found[name].shape), tuple(wanted[name].shape))
            problems.append(f"{name} has shape {shapes[0]}, expected {shapes[1]}")
        elif not found[name].isfinite().all():
            problems.append(f"{name} has numbers that are not finite")
    return problems


def _first_line(error: Exception) -> str:
    return next(iter(str(error).splitlines()), "")[:200]
