"""Where benchmarks and experiments find the OPV2V sample."""

from __future__ import annotations

import os
import tarfile
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from swarm.errors import WorldError

ARCHIVE = Path("opv2v-sample") / "opv2v-sample.tar.xz"


@contextmanager
def opv2v_sample() -> Iterator[Path]:
    """The unpacked sample scenario, for as long as the context is open.

    Looks for the archive in $COADAPT_DATA, then in ../shared/data beside the repository. Raises
    WorldError when neither has it.
    """
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    roots = [Path(root) for root in (os.environ.get("COADAPT_DATA"), beside) if root]
    archive = next((root / ARCHIVE for root in roots if (root / ARCHIVE).is_file()), None)
    if archive is None:
        raise WorldError(
            f"no {ARCHIVE} in {', '.join(map(str, roots))}: set COADAPT_DATA to the folder with it"
        )
    with tempfile.TemporaryDirectory(prefix="coadapt-opv2v-") as target:
        with tarfile.open(archive) as packed:
            packed.extractall(target, filter="data")
        yield next(Path(target).rglob("data_protocol.yaml")).parent
