"""Runtimes: network namespaces or Docker, behind one interface.

Every module of this package that has `RUNTIMES` adds them.
"""

from __future__ import annotations

from deploy.docker import image
from deploy.runtime import Runtime
from swarm.errors import DeployError
from swarm.registry import by_name, registered


def names() -> tuple[str, ...]:
    """All runtimes, whether this machine can run them or not, sorted."""
    return tuple(_all_runtimes())


def get(name: str) -> Runtime:
    """The runtime of that name, whether this machine can run it or not.

    Raises DeployError for an unknown one.
    """
    found = _all_runtimes()
    if name not in found:
        raise DeployError(f"runtime {name!r} is not known; allowed: auto, {', '.join(found)}")
    return found[name]


def choose(name: str) -> tuple[Runtime, str]:
    """The runtime to start a swarm with, and one sentence that says why this one.

    `auto` takes Docker when an engine answers, else network namespaces. Raises DeployError when
    the named runtime, or with `auto` neither, can run here.
    """
    if name != "auto":
        chosen = get(name)
        if (reason := _why_not(chosen)) is not None:
            raise DeployError(f"runtime {name} cannot run here: {reason}")
        return chosen, f"runtime {name}: asked for"
    docker, netns = get("docker"), get("netns")
    no_docker = _why_not(docker)
    if no_docker is None:
        return docker, "runtime docker: an engine answers"
    no_netns = _why_not(netns)
    if no_netns is None:
        return netns, f"runtime netns: Docker cannot be used ({no_docker})"
    raise DeployError(f"no runtime can run here; docker: {no_docker}; netns: {no_netns}")


def _why_not(runtime: Runtime) -> str | None:
    """Why it cannot start a swarm here; with an engine but no sources, Docker can still end one."""
    return runtime.available() or (image.why_not() if runtime.name == "docker" else None)


def _all_runtimes() -> dict[str, Runtime]:
    made = (make() for make in registered("RUNTIMES", "deploy.runtimes"))
    return by_name(made, "runtimes", DeployError)
