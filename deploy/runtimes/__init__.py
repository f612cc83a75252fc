"""Runtimes: network namespaces or Docker, behind one interface."""

from __future__ import annotations

from deploy.runtime import Runtime
from deploy.spec import RuntimeName
from swarm.errors import DeployError


def get(name: RuntimeName) -> Runtime:
    """The runtime of that name, whether this machine can run it or not."""
    if name == "docker":
        from deploy.runtimes.docker import DockerRuntime

        return DockerRuntime()
    from deploy.runtimes.netns import NetnsRuntime

    return NetnsRuntime()


def choose(name: str) -> tuple[Runtime, str]:
    """The runtime to start a swarm with, and one sentence that says why this one.

    `auto` takes Docker when an engine answers, else network namespaces. Raises DeployError when
    the named runtime, or with `auto` neither, can run here.
    """
    if name not in ("auto", "docker", "netns"):
        raise DeployError(f"runtime {name!r} is not known; allowed: auto, docker, netns")
    if name != "auto":
        chosen = get("docker" if name == "docker" else "netns")
        reason = _why_not_docker() if name == "docker" else chosen.available()
        if reason is not None:
            raise DeployError(f"runtime {name} cannot run here: {reason}")
        return chosen, f"runtime {name}: asked for"
    no_docker = _why_not_docker()
    if no_docker is None:
        return get("docker"), "runtime docker: an engine answers"
    netns = get("netns")
    no_netns = netns.available()
    if no_netns is None:
        return netns, f"runtime netns: Docker cannot be used ({no_docker})"
    raise DeployError(f"no runtime can run here; docker: {no_docker}; netns: {no_netns}")


def _why_not_docker() -> str | None:
    from deploy.docker import image

    return get("docker").available() or image.why_not()
