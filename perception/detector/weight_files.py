"""Where the weights that come with the project are. Does not load PyTorch."""

from __future__ import annotations

from pathlib import Path

_FOLDER = Path(__file__).resolve().parent / "weights"


def weight_file(name: str) -> Path:
    """The file for a configuration, whether it is there or not."""
    return _FOLDER / f"{name}.safetensors"


def calibration_file(name: str) -> Path:
    """What the scores of a configuration's weights mean, whether it is there or not."""
    return _FOLDER / f"{name}.calibration.json"


def has_weights(name: str) -> bool:
    """Whether weights of a configuration come with the project."""
    return weight_file(name).is_file()
