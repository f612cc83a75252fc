"""Builds the swarm's Docker image; works without a registry and without network in the build.

The wheels are downloaded on the host, so that a site without network can carry them, and a build
never meets a proxy's certificates.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from swarm.errors import DeployError

REPOSITORY = Path(__file__).resolve().parents[2]
PACKAGES = (
    "coadapt",
    "deploy",
    "ego_agent",
    "llm_gateway",
    "network_controller",
    "options",
    "perception",
    "robot_agent",
    "sensing",
    "swarm",
    "worlds",
)
LOCKS = (REPOSITORY / "requirements.lock", REPOSITORY / "requirements-torch.lock")
DOCKERFILE = REPOSITORY / "deploy" / "docker" / "Dockerfile"
PUBLIC_BASE = (
    "python:3.11-slim-bookworm"
    "@sha256:a36c24f9cbdf4fd0f52d67f0823eeac19c2028c637cecc392d97f980d4fec56b"
)
"""Python 3.11.16. The digest is the index's, in which each machine finds its own image."""
PYTHON_VERSION = "3.11"
PLATFORMS = ("manylinux_2_34", "manylinux_2_28", "manylinux_2_17", "manylinux2014", "manylinux1")

Say = Callable[[str], None]


def ensure_image(say: Say) -> str:
    """The tag of an image with this source and these pinned wheels; builds it when it is missing.

    Raises DeployError when the base, the wheels or the build fail.
    """
    tag = f"coadapt-edge:{_fingerprint()}"
    if exists(tag):
        return tag
    base = _ensure_base(say)
    wheels = [wheelhouse(lock, say) for lock in LOCKS]
    context = REPOSITORY / "build" / "image"
    shutil.rmtree(context, ignore_errors=True)
    source = context / "source"
    source.mkdir(parents=True)
    for package in PACKAGES:
        shutil.copytree(
            REPOSITORY / package, source / package, ignore=shutil.ignore_patterns("__pycache__")
        )
    for folder in wheels:
        shutil.copytree(folder, context / "wheelhouse", copy_function=os.link, dirs_exist_ok=True)
    for file in (*LOCKS, DOCKERFILE):
        shutil.copy(file, context)
    build(tag, base, context, say)
    return tag


def why_not() -> str | None:
    """None when the sources that the image is made of are here, else the reason why not."""
    if DOCKERFILE.is_file() and all(lock.is_file() for lock in LOCKS):
        return None
    return (
        "its image is built from a checkout of the repository, and this is an installed wheel; "
        "use RUNTIME=netns (--runtime netns), or `make up` in a checkout"
    )


def build(tag: str, base: str, context: Path, say: Say) -> None:
    """Builds an image on another one, and removes the context. Raises DeployError."""
    say(f"building image {tag} on {base}")
    made = _docker(
        *("build", "--quiet", "--tag", tag, "--build-arg", f"BASE={base}"),
        str(context),
        timeout_s=1800,
    )
    if made.returncode != 0:
        raise DeployError(f"docker build failed:\n{_tail(made)}")
    shutil.rmtree(context, ignore_errors=True)


def exists(tag: str) -> bool:
    """Whether the engine has an image of that name."""
    return _docker("image", "inspect", tag).returncode == 0


def pull(name: str) -> str:
    """Gets an image from its registry. Returns why it cannot be had; empty when it is there."""
    pulled = _docker("pull", name, timeout_s=900)
    return "" if pulled.returncode == 0 else _tail(pulled, 1)


def _fingerprint() -> str:
    """Names the content of everything that goes into the image."""
    digest = hashlib.sha256()
    files = [*LOCKS, DOCKERFILE]
    for package in PACKAGES:
        files += (p for p in (REPOSITORY / package).rglob("*") if p.is_file())
    for path in sorted(files):
        if "__pycache__" not in path.parts:
            digest.update(str(path.relative_to(REPOSITORY)).encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def _ensure_base(say: Say) -> str:
    """COADAPT_BASE_IMAGE, else the public image, else one made with debootstrap."""
    wanted = os.environ.get("COADAPT_BASE_IMAGE")
    script = REPOSITORY / "deploy" / "docker" / "base.sh"
    local = f"coadapt-base:{hashlib.sha256(script.read_bytes()).hexdigest()[:12]}"
    for image in (wanted,) if wanted else (PUBLIC_BASE, local):
        if exists(image):
            return image
    trouble = pull(wanted or PUBLIC_BASE)
    if not trouble:
        return wanted or PUBLIC_BASE
    if wanted:
        raise DeployError(f"COADAPT_BASE_IMAGE = {wanted!r} cannot be pulled: {trouble}")
    say(f"{PUBLIC_BASE} cannot be pulled; making {local} with debootstrap (about a minute)")
    made = subprocess.run(
        ["sh", str(script), local], capture_output=True, text=True, timeout=900, check=False
    )
    if made.returncode != 0:
        raise DeployError(
            f"no base image: pulling {PUBLIC_BASE} failed ({trouble}), and debootstrap "
            f"failed:\n{_tail(made)}\nSet COADAPT_BASE_IMAGE to an image with Python 3.11."
        )
    return local


def wheelhouse(lock: Path, say: Say) -> Path:
    """A folder with a wheel for every line of a lock, got once a lock.

    Wheels that lie where pip looks for files (PIP_FIND_LINKS) are taken without asking an index.
    Raises DeployError when they cannot be downloaded.
    """
    name = hashlib.sha256(lock.read_bytes()).hexdigest()[:12]
    wheels = REPOSITORY / "build" / "wheelhouse" / name
    if wheels.is_dir():
        return wheels
    say(f"getting the wheels of {lock.name}")
    partial = wheels.with_name(f"{name}.partial")
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    pip = [sys.executable, "-m", "pip"]
    pinned = ["--quiet", "--no-deps", "--requirement", str(lock)]
    if "--hash=" in lock.read_text():
        pinned.append("--require-hashes")
    if f"{sys.version_info.major}.{sys.version_info.minor}" == PYTHON_VERSION:
        command = [*pip, "wheel", *pinned, "--wheel-dir", str(partial)]
    else:
        command = [*pip, "download", *pinned, "--dest", str(partial)]
        command += ["--python-version", PYTHON_VERSION, "--implementation", "cp"]
        command += ["--only-binary", ":all:"]
        for platform in PLATFORMS:
            command += ["--platform", f"{platform}_{os.uname().machine}"]
    for local_only in (["--no-index"], []):
        done = subprocess.run(
            [*command, *local_only], capture_output=True, text=True, timeout=1800, check=False
        )
        if done.returncode == 0:
            break
    else:
        raise DeployError(f"the wheels of {lock.name} cannot be downloaded:\n{_tail(done)}")
    partial.rename(wheels)
    return wheels


def _docker(*arguments: str, timeout_s: float = 60) -> subprocess.CompletedProcess[str]:
    try:
        return subprocess.run(
            ["docker", *arguments], capture_output=True, text=True, timeout=timeout_s, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise DeployError(f"docker {arguments[0]} did not run: {error}") from error


def _tail(done: subprocess.CompletedProcess[str], lines: int = 15) -> str:
    return "\n".join((done.stderr or done.stdout).strip().splitlines()[-lines:])
