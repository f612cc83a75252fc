"""Fixtures that several test files share."""

from __future__ import annotations

import os
import shutil
from collections.abc import Generator
from pathlib import Path

import pytest
from hypothesis import settings

from swarm.errors import WorldError
from tests.support.zenoh_fixtures import (  # noqa: F401
    open_session,
    own_router,
    pair,
    shared_router,
    swarm_name,
)
from worlds.sample import opv2v_sample

# A busy machine is no failure: no test judges a time.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")

FRAMES = 16
"""Of real data: what the archive of the sample holds; `make data` brings more."""


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Where $COADAPT_REQUIRE=all (as in CI) nothing may be missing: a skip is a failure."""
    report = yield
    if report.skipped and os.environ.get("COADAPT_REQUIRE") == "all":
        report.outcome = "failed"
        report.longrepr = f"skipped where nothing may be missing: {report.longrepr}"
    return report


@pytest.fixture(scope="session")
def opv2v_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The OPV2V sample scenario (a folder with data_protocol.yaml), its first 16 frames."""
    try:
        whole = opv2v_sample()
    except WorldError as error:
        pytest.skip(str(error))
    target = tmp_path_factory.mktemp("opv2v") / whole.name
    for vehicle in (path for path in whole.iterdir() if path.is_dir()):
        (target / vehicle.name).mkdir(parents=True)
        for description in sorted(vehicle.glob("*.yaml"))[:FRAMES]:
            for file in (description, description.with_suffix(".pcd")):
                (target / vehicle.name / file.name).symlink_to(file)
    shutil.copy(whole / "data_protocol.yaml", target)
    return target
