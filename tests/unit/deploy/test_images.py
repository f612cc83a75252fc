"""Images come from registries by digest: a tag may be moved to another image."""

from __future__ import annotations

import re

import pytest

from deploy.docker import grafana, image
from deploy.docker.image import DOCKERFILE

BY_DIGEST = re.compile(r"[a-z/]+:[\w.-]+@sha256:[0-9a-f]{64}")


@pytest.mark.parametrize("name", [image.PUBLIC_BASE, grafana.IMAGE])
def test_what_is_pulled_is_named_by_digest(name: str) -> None:
    assert BY_DIGEST.fullmatch(name)


def test_the_dockerfile_builds_on_the_same_image() -> None:
    (base,) = re.findall(r"^ARG BASE=(.*)$", DOCKERFILE.read_text(), re.MULTILINE)
    assert base == image.PUBLIC_BASE
    froms = set(re.findall(r"^FROM (\S+)", DOCKERFILE.read_text(), re.MULTILINE))
    assert froms == {"${BASE}"}
