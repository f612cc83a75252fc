"""Where benchmarks and experiments find real data: the OPV2V sample, recorded links, results."""

from __future__ import annotations

import os
import tarfile
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from swarm.errors import WorldError

ARCHIVE = Path("opv2v-sample") / "opv2v-sample.tar.xz"


def data_roots() -> list[Path]:
    """Where real data may lie: $COADAPT_DATA, then ../shared/data beside the repository."""
    beside = Path(__file__).resolve().parents[3] / "shared" / "data"
    return [Path(root) for root in (os.environ.get("COADAPT_DATA"), beside) if root]


def data_folder(name: Path) -> Path | None:
    """The first folder of that name in one of them; None where there is none."""
    return next((root / name for root in data_roots() if (root / name).is_dir()), None)


@contextmanager
def opv2v_sample() -> Iterator[Path]:
    """The unpacked sample scenario, for as long as the context is open.

    Raises WorldError when none of `data_roots` has it.
    """
    roots = data_roots()
    archive = next((root / ARCHIVE for root in roots if (root / ARCHIVE).is_file()), None)
    if archive is None:
        raise WorldError(
            f"no {ARCHIVE} in {', '.join(map(str, roots))}: set COADAPT_DATA to the folder with it"
        )
    with tempfile.TemporaryDirectory(prefix="coadapt-opv2v-") as target:
        with tarfile.open(archive) as packed:
            packed.extractall(target, filter="data")
        yield next(Path(target).rglob("data_protocol.yaml")).parent
