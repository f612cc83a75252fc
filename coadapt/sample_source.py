"""Brings the public OPV2V sample from the git repository that carries it."""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swarm.errors import WorldError
from worlds.sample import SAMPLE

if TYPE_CHECKING:
    from worlds.opv2v.world import Opv2vWorld

FOLDER = "opv2v_data_dumping/test/2021_09_03_09_32_17"
SCENARIO = Path(FOLDER).name
FACTS = "source.json"
"""In the scenario's folder: where it comes from, and the git blob of each file."""
LICENCE = "LICENSE"
_SUFFIXES = (".pcd", ".yaml")
_REGULAR = ("100644", "100755")
# A connection that has brought less than 1 kB/s for a minute is taken to be dead.
_GIT = (
    *("git", "-c", "core.autocrlf=false", "-c", "advice.detachedHead=false"),
    *("-c", "http.lowSpeedLimit=1000", "-c", "http.lowSpeedTime=60"),
)


@dataclass(frozen=True)
class Source:
    """One version of the sample; the defaults are CoAdapt's own repository."""

    url: str = "https://github.com/houssamhh/coadapt"
    commit: str = "3e44cff04087d2d5d4898361a7ee8b65f563004c"
    """A commit's full hash, a branch or a tag."""
    tree: str = "0797a3267848ad8e064701e829b917b58238bc36"
    """The git tree of the scenario's folder: the same wherever the folder comes from."""


def place_in(home: Path) -> Path:
    """Where the scenario is put in a data folder."""
    return home / SAMPLE / SCENARIO


def bring(source: Source, home: Path) -> bool:
    """Puts the sample's scans and descriptions (no images) into `place_in(home)`.

    Returns False where it is there already, unchanged. What is put there is whole: the scenario's
    tree is that of the source, and every file is that of the tree. A folder that somebody put there
    by hand (without `source.json`) is left as it is.

    Raises WorldError when git is missing, the source cannot be read or is another one, the disk
    cannot be written, or another process brings the sample.
    """
    place = place_in(home)
    try:
        with _alone(place.parent):
            if place.is_dir() and _holds(place, source.tree):
                return False
            for left in home.glob(f"{SAMPLE}.partial-*"):
                shutil.rmtree(left, ignore_errors=True)
            partial = Path(tempfile.mkdtemp(prefix=f"{SAMPLE}.partial-", dir=home))
            try:
                whole = _fetch(source, partial, place)
                read_all(whole)
                _replace(place, whole, partial / "old")
            finally:
                shutil.rmtree(partial, ignore_errors=True)
    except OSError as error:
        raise WorldError(f"the OPV2V sample cannot be put into {place}: {error}") from error
    return True


def read_all(folder: Path) -> Opv2vWorld:
    """The scenario in a folder. Raises WorldError for a scan or description that cannot be read."""
    # Imported here: other commands need no arrays.
    from worlds.clouds.pcd import read_pcd
    from worlds.opv2v.world import Opv2vWorld

    world = Opv2vWorld(folder)
    for robot in world.robots:
        for frame in range(world.frame_count):
            world.pose(robot, frame)
            read_pcd(folder / robot / f"{world.frame_names[frame]}.pcd")
    return world


def facts_of(place: Path) -> Mapping[str, Any] | None:
    """What `source.json` says; None where there is none, or one that cannot be read."""
    try:
        facts = json.loads((place / FACTS).read_text())
    except (OSError, ValueError):
        return None
    return facts if isinstance(facts, dict) and isinstance(facts.get("files"), dict) else None


def blob_id(path: Path) -> str:
    """The name that git gives to a file's content. Raises OSError."""
    data = path.read_bytes()
    return hashlib.sha1(b"blob %d\0" % len(data) + data, usedforsecurity=False).hexdigest()


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    folder.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise WorldError(f"another process brings the sample into {folder}") from error
        yield
    finally:
        os.close(descriptor)


def _holds(place: Path, tree: str) -> bool:
    """Whether a folder needs nothing: put there by hand, or of that tree and unchanged."""
    if not (place / FACTS).exists():
        return True
    facts = facts_of(place)
    if facts is None or facts.get("tree") != tree:
        return False
    return all(
        (place / name).is_file() and blob_id(place / name) == blob
        for name, blob in facts["files"].items()
    )


def _fetch(source: Source, partial: Path, place: Path) -> Path:
    """A folder with the verified files, their source and licence."""
    clone, whole = partial / "clone", partial / "whole"
    clone.mkdir()
    try:
        _git(clone, "init", "--quiet")
        _git(clone, "remote", "add", "origin", source.url)
        patterns = [f"/{FOLDER}/**/*{suffix}" for suffix in _SUFFIXES]
        _git(clone, "sparse-checkout", "set", "--no-cone", f"/{LICENCE}", *patterns)
        _git(clone, "fetch", "--depth=1", "--filter=blob:none", "origin", source.commit)
        commit = _git(clone, "rev-parse", "FETCH_HEAD^{commit}").strip()
        _check_tree(clone, commit, source)
        _git(clone, "checkout", "--detach", commit)
        files = _listed(clone, commit)
    except _GitError as error:
        raise WorldError(f"{error}\n{_by_hand(source, place)}") from error
    for name, blob in files.items():
        path = clone / FOLDER / name
        if not path.is_file() or blob_id(path) != blob:
            raise WorldError(f"{name} of {source.url} came damaged; run `coadapt data` again")
        (whole / name).parent.mkdir(parents=True, exist_ok=True)
        path.rename(whole / name)
    if (clone / LICENCE).is_file():
        (clone / LICENCE).rename(whole / LICENCE)
    facts = {"url": source.url, "commit": commit, "folder": FOLDER, "tree": source.tree}
    (whole / FACTS).write_text(json.dumps(facts | {"files": files}, indent=1) + "\n")
    return whole


def _check_tree(clone: Path, commit: str, source: Source) -> None:
    """Before the files are downloaded. Raises WorldError."""
    try:
        found = _git(clone, "rev-parse", "--verify", "--quiet", f"{commit}:{FOLDER}").strip()
    except _GitError as error:
        raise WorldError(f"{source.url} has no folder {FOLDER} at {commit}") from error
    if found != source.tree:
        raise WorldError(
            f"{FOLDER} of {source.url} at {commit} is not the sample: its git tree is {found}, "
            f"and {source.tree} was expected; nothing was put in place (DATA_TREE=HASH or --tree "
            "names another one on purpose)"
        )


def _listed(clone: Path, commit: str) -> dict[str, str]:
    """The blob of every scan and description, by its path in the scenario."""
    files = {}
    for line in _git(clone, "ls-tree", "-r", "-z", f"{commit}:{FOLDER}").split("\0"):
        about, _, name = line.partition("\t")
        if name.endswith(_SUFFIXES) and about.split()[0] in _REGULAR:
            files[name] = about.split()[2]
    return files


def _replace(place: Path, whole: Path, old: Path) -> None:
    if place.is_dir():
        place.rename(old)
    whole.rename(place)


def _by_hand(source: Source, place: Path) -> str:
    return (
        "By hand, where there is a network:\n"
        f"  git clone --filter=blob:none --no-checkout {source.url} sample && cd sample\n"
        f"  git sparse-checkout set {FOLDER} && git checkout {source.commit}\n"
        f"Then copy the folder {FOLDER} to {place} (its images are not needed)."
    )


class _GitError(Exception):
    """A git command failed; the text says which and why."""


def _git(folder: Path, *arguments: str) -> str:
    """Standard output. Its progress is shown on a terminal. Raises _GitError, or WorldError
    without git."""
    shown = sys.stderr.isatty() and arguments[0] in ("fetch", "checkout")
    # A repository that surrounds this process (a git hook's, say) is not the clone.
    environment = {k: v for k, v in os.environ.items() if not k.startswith("GIT_")}
    try:
        done = subprocess.run(
            [*_GIT, *arguments],
            cwd=folder,
            env=environment | {"GIT_TERMINAL_PROMPT": "0", "LC_ALL": "C"},
            stdout=subprocess.PIPE,
            stderr=None if shown else subprocess.PIPE,
            text=True,
            check=False,
        )
    except FileNotFoundError as error:
        raise WorldError(
            "the program `git` is missing; install it (Debian: apt-get install git)"
        ) from error
    if done.returncode != 0:
        why = (done.stderr or "").strip() or f"exit status {done.returncode}"
        raise _GitError(f"git {arguments[0]} failed: {why}")
    return done.stdout
