"""Fusion algorithms: a file each, with the function `fusion(detector)`.

The file's name, with hyphens for underscores, is the algorithm's: so they can be named without
loading any, and with it PyTorch.
"""

from __future__ import annotations

import pkgutil


def all_fusions() -> tuple[str, ...]:
    """All algorithms, whether they can be used or not, sorted."""
    files = (module.name for module in pkgutil.iter_modules(__path__))
    return tuple(sorted(name.replace("_", "-") for name in files))
