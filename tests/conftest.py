"""Fixtures that several test files share."""

from __future__ import annotations

import os
import tarfile
from collections.abc import Generator
from pathlib import Path

import pytest
from hypothesis import settings

from tests.support.data import data_root
from tests.support.zenoh_fixtures import (  # noqa: F401
    open_session,
    own_router,
    pair,
    shared_router,
    swarm_name,
)

# A busy machine is no failure: no test judges a time.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")


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
    """The unpacked OPV2V sample scenario (a folder with data_protocol.yaml)."""
    root = data_root()
    archive = root / "opv2v-sample" / "opv2v-sample.tar.xz" if root else None
    if archive is None or not archive.is_file():
        pytest.skip("no OPV2V sample: set COADAPT_DATA to a folder with opv2v-sample/")
    target = tmp_path_factory.mktemp("opv2v")
    with tarfile.open(archive) as packed:
        packed.extractall(target, filter="data")
    return next(target.rglob("data_protocol.yaml")).parent
