"""The record of a running swarm in its run directory, by which later commands find it."""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import msgspec

from deploy.progress import typed
from deploy.spec import SwarmSpec, run_base, run_dir_of
from swarm.errors import DeployError
from swarm.files import write_whole
from swarm.settings import Name
from swarm.zenoh_config import MAX_UNIX_PATH

STATE_FILE = "state.json"
LONGEST_SOCKET = "ego-metrics.sock"


class ProcessMark(msgspec.Struct, frozen=True):
    """A process of this machine, told apart from a later one with the same id."""

    pid: int
    started_ticks: int
    """Field 22 of /proc/PID/stat: clock ticks after boot."""


class State(msgspec.Struct, frozen=True, kw_only=True):
    """What `up` leaves for the other commands."""

    runtime: Name
    spec: SwarmSpec
    router: str
    """The router, for tools on the host, as `swarm.zenoh_config.client_config` takes it."""
    prometheus_url: str = ""
    """Prometheus on the host; empty when the swarm has none."""
    ego_metrics_url: str = ""
    qod_url: str = ""
    """The Quality-on-Demand API on the host."""
    llm_url: str = ""
    """The LLM gateway's HTTP endpoint on the host; empty without a gateway."""
    grafana_url: str = ""
    """Grafana on the host; empty without."""
    console_url: str = ""
    """The operator's console on the host; empty without."""
    processes: dict[str, ProcessMark] = {}
    """Processes on the host that belong to the swarm, by what they do."""


def read_state(swarm: str) -> State | None:
    """The record of a swarm, or None when there is none.

    Raises DeployError when the record cannot be read.
    """
    path = run_dir_of(swarm) / STATE_FILE
    try:
        return msgspec.json.decode(path.read_bytes(), type=State)
    except FileNotFoundError:
        return None
    except (OSError, msgspec.DecodeError) as error:
        raise DeployError(
            f"record {path} of swarm {swarm!r} cannot be read: {error}; "
            f"run `{typed('down', swarm)}`"
        ) from error


def need_state(swarm: str) -> State:
    """The record of a swarm. Raises DeployError when no such swarm runs."""
    state = read_state(swarm)
    if state is None:
        raise DeployError(
            f"no swarm {swarm!r} is running; start one with `{typed('up', swarm)}`{_others()}"
        )
    return state


def seen_by(state: State, ego: str | None) -> State:
    """The record as commands see it that are about one of several egos; None: the first one.

    Raises DeployError for a robot that does not decide.
    """
    if ego is None or ego == state.spec.ego:
        return state
    if ego not in state.spec.all_egos:
        raise DeployError(
            f"robot {ego!r} does not decide in swarm {state.spec.swarm!r}; "
            f"egos are {', '.join(state.spec.all_egos)}"
        )
    spec = msgspec.structs.replace(state.spec, ego=ego, ego_standby=None)
    return msgspec.structs.replace(state, spec=spec)


def swarms() -> tuple[str, ...]:
    """Names of this user's swarms that have a record, sorted. Raises DeployError."""
    try:
        return tuple(sorted(path.parent.name for path in run_base().glob(f"*/{STATE_FILE}")))
    except OSError as error:
        raise DeployError(f"run directory {run_base()} cannot be read: {error}") from error


def _others() -> str:
    names = swarms()
    return f" (there is {', '.join(names)}: see `{typed('list')}`)" if names else ""


def check_same(running: State, spec: SwarmSpec) -> None:
    """Raises DeployError when a swarm that runs is not as `spec` wants it."""
    different = [
        f"{name} {_shown(getattr(running.spec, name))} (wanted: {_shown(getattr(spec, name))})"
        for name in running.spec.differences(spec)
    ]
    if different:
        raise DeployError(
            f"swarm {spec.swarm!r} already runs with {', '.join(different)}; "
            f"run `{typed('down', spec.swarm)}` first, or give this one another name"
        )


def _shown(value: object) -> str:
    return ", ".join(value) if isinstance(value, tuple) else repr(value)


def write_state(state: State) -> None:
    """Writes the record in one step, so that a reader sees all of it or none."""
    path = Path(state.spec.run_dir) / STATE_FILE
    write_whole(path, msgspec.json.format(msgspec.json.encode(state)))


def make_run_dir(spec: SwarmSpec) -> Path:
    """The run directory, made for its owner alone.

    Raises DeployError when it cannot be made, belongs to someone else, or is too long for the
    paths of Unix sockets.
    """
    path = Path(spec.run_dir)
    longest = len(str(path / LONGEST_SOCKET).encode())
    if longest > MAX_UNIX_PATH:
        raise DeployError(
            f"run directory {path} is too long: its sockets' paths take {longest} bytes, allowed "
            f"are {MAX_UNIX_PATH}; set COADAPT_RUN_DIR to a shorter one"
        )
    try:
        for directory in (path.parent, path):
            directory.mkdir(mode=0o700, exist_ok=True)
            facts = directory.lstat()
            if directory.is_symlink() or facts.st_uid != os.getuid():
                raise DeployError(f"run directory {directory} belongs to someone else; remove it")
            # Where it was there before: who may enter it may steer the swarm.
            directory.chmod(0o700)
    except OSError as error:
        raise DeployError(
            f"run directory {path} cannot be made: {error}; set COADAPT_RUN_DIR to another place"
        ) from error
    return path


def remove_run_dir(swarm: str) -> bool:
    """Removes a swarm's run directory. Returns False when there is none."""
    path = run_dir_of(swarm)
    if not path.exists():
        return False
    try:
        shutil.rmtree(path)
    except OSError as error:
        raise DeployError(f"run directory {path} cannot be removed: {error}") from error
    return True


@contextlib.contextmanager
def exclusive() -> Iterator[None]:
    """Keeps other `up` and `down` commands of this user waiting."""
    base = run_base()
    try:
        base.mkdir(mode=0o700, parents=True, exist_ok=True)
        descriptor = os.open(base, os.O_RDONLY | os.O_DIRECTORY)
    except OSError as error:
        raise DeployError(
            f"run directory {base} cannot be used: {error}; set COADAPT_RUN_DIR to another place"
        ) from error
    try:
        if os.fstat(descriptor).st_uid != os.getuid():
            raise DeployError(f"run directory {base} belongs to someone else; remove it")
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)
