"""The image of a gateway with an embedded language model: the swarm's own, and a layer above it."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from deploy.docker.image import REPOSITORY, Say, build, exists, wheelhouse
from swarm.errors import DeployError

BUILD_S = 1800
LOCK = REPOSITORY / "requirements-llm.lock"
DOCKERFILE = REPOSITORY / "deploy" / "docker" / "llm.Dockerfile"
BUILT_HERE = re.compile(r"^llama-cpp-python==.*\n(?: .*\n)*", re.MULTILINE)
"""The lock's lines of the one package that is built for this machine's processor."""


def ensure_llm_image(base: str, say: Say) -> str:
    """The tag of an image with the model above `base`; builds it when it is missing, and tries the
    model out in it.

    Raises DeployError when the package or the image cannot be built, or the model does not run.
    """
    flags = _script("--flags", timeout_s=60)
    digest = hashlib.sha256(LOCK.read_bytes() + DOCKERFILE.read_bytes() + flags.encode())
    tag = f"coadapt-llm:{base.rpartition(':')[2]}-{digest.hexdigest()[:12]}"
    if exists(tag):
        return tag
    say("building llama.cpp for this processor, unless it is there already: some minutes")
    built = Path(_script("--wheel", timeout_s=BUILD_S).strip())
    context = REPOSITORY / "build" / "llm-image"
    shutil.rmtree(context, ignore_errors=True)
    wheels = context / "wheels"
    wheels.mkdir(parents=True)
    others = context / "requirements.txt"
    others.write_text(BUILT_HERE.sub("", LOCK.read_text()))
    for folder in (built, wheelhouse(others, say)):
        for wheel in folder.glob("*.whl"):
            shutil.copy(wheel, wheels)
    shutil.copy(DOCKERFILE, context / "Dockerfile")
    build(tag, base, context, say)
    return tag


def _script(option: str, timeout_s: float) -> str:
    """What `deploy/llm.sh` prints. Raises DeployError with its words."""
    try:
        done = subprocess.run(
            ["sh", str(REPOSITORY / "deploy" / "llm.sh"), option],
            env={**os.environ, "VENV": sys.prefix},
            capture_output=True,
            text=True,
            timeout=timeout_s,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise DeployError(f"llama.cpp was not built within {timeout_s:.0f} s") from error
    if done.returncode != 0:
        raise DeployError(f"llama.cpp cannot be built:\n{done.stderr.strip()}")
    return done.stdout
