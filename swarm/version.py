"""Which version of the package this process runs."""

from __future__ import annotations

from functools import cache
from importlib import metadata

DISTRIBUTION = "coadapt-edge"


@cache
def installed_version() -> str:
    """The package's version; empty for sources that are not installed."""
    try:
        return metadata.version(DISTRIBUTION)
    except metadata.PackageNotFoundError:
        return ""
