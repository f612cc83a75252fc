"""Where real data lies: the OPV2V sample, recorded links, published results."""

from __future__ import annotations

import lzma
import os
import shutil
import tarfile
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from swarm.errors import WorldError

REPOSITORY = Path(__file__).resolve().parents[1]
SAMPLE = "opv2v-sample"
ARCHIVE = "opv2v-sample.tar.xz"


def is_checkout() -> bool:
    """Whether this code runs from a checkout of the repository, not from an installed wheel."""
    return (REPOSITORY / "pyproject.toml").is_file()


def data_home() -> Path:
    """Where data is put that is brought here: `$COADAPT_DATA`, else `var/data`, in the repository
    or, without a checkout, in the current directory."""
    named = os.environ.get("COADAPT_DATA")
    return Path(named).absolute() if named else _var_data()


def data_roots() -> list[Path]:
    """Where real data may lie, in the order of the search: `$COADAPT_DATA`, `var/data`, and
    `../shared/data` beside the repository."""
    roots = [data_home(), _var_data()]
    if is_checkout():
        roots.append(REPOSITORY.parent / "shared" / "data")
    return list(dict.fromkeys(roots))


def data_folder(name: Path) -> Path | None:
    """The first folder of that name in one of them; None where there is none."""
    return next((root / name for root in data_roots() if (root / name).is_dir()), None)


def opv2v_sample() -> Path:
    """The sample scenario (a folder with `data_protocol.yaml`).

    An archive is unpacked once, into `var/data`. Raises WorldError when none of `data_roots` has
    the sample as a folder or archive, or when an archive cannot be unpacked.
    """
    for root in data_roots():
        scenario = _scenario(root / SAMPLE)
        if scenario is not None:
            return scenario
        archive = root / SAMPLE / ARCHIVE
        if archive.is_file():
            return _unpacked(archive)
    raise WorldError(
        f"no OPV2V sample in {', '.join(map(str, data_roots()))}: `make data` (`coadapt data`) "
        f"brings it, or set COADAPT_DATA to a folder with {SAMPLE}/"
    )


def _var_data() -> Path:
    return (REPOSITORY if is_checkout() else Path.cwd()) / "var" / "data"


def _scenario(folder: Path) -> Path | None:
    found = sorted(path.parent for path in folder.rglob("data_protocol.yaml"))
    return found[0] if found else None


def _unpacked(archive: Path) -> Path:
    try:
        stat = archive.stat()
        # The file's time and size: another archive of the same name is another sample.
        place = _var_data() / f"unpacked-{stat.st_mtime_ns:x}-{stat.st_size:x}"
        if not place.is_dir():
            place.parent.mkdir(parents=True, exist_ok=True)
            _unpack(archive, place)
    except (OSError, EOFError, tarfile.TarError, lzma.LZMAError) as error:
        raise WorldError(f"the sample {archive} cannot be unpacked: {error}") from error
    scenario = _scenario(place)
    if scenario is None:
        raise WorldError(f"the sample {archive} has no data_protocol.yaml")
    return scenario


_FILTERED: dict[str, Any] = {"filter": "data"} if hasattr(tarfile, "data_filter") else {}
"""Python 3.11.2, which Debian 12 has, knows no filters yet."""


def _within(packed: tarfile.TarFile, place: Path) -> Iterator[tarfile.TarInfo]:
    """Files and folders that lie in the place; an archive of data holds nothing else. Raises
    WorldError for one that does."""
    for member in packed:
        inside = (place / member.name).resolve().is_relative_to(place.resolve())
        if not inside or not (member.isfile() or member.isdir()):
            raise WorldError(f"the sample {packed.name!s} holds {member.name!r}, which is no data")
        yield member


def _unpack(archive: Path, place: Path) -> None:
    """Unpacks beside the place and renames at the end, so that the place is whole or not there."""
    partial = Path(tempfile.mkdtemp(prefix=f"{place.name}.partial-", dir=place.parent))
    try:
        with tarfile.open(archive) as packed:
            packed.extractall(partial, members=_within(packed, partial), **_FILTERED)
        try:
            partial.rename(place)
        except OSError:
            # Another process was faster.
            if not place.is_dir():
                raise
    finally:
        shutil.rmtree(partial, ignore_errors=True)
