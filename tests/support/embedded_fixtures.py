"""The real embedded model, loaded once, for tests of what runs it."""

from __future__ import annotations

from pathlib import Path

import pytest

from llm_gateway.backends.llamacpp import models
from llm_gateway.backends.llamacpp.engine import Engine
from llm_gateway.backends.llamacpp.native import Native
from tests.support.embedded_model import CONTEXT, SEQUENCES


@pytest.fixture(scope="session")
def model_file() -> Path:
    """A real model that llama.cpp can run here."""
    if not models.runtime_installed() or "smollm2-135m" not in models.installed_models():
        pytest.skip(f"the embedded model is not installed: {models.INSTALL}")
    return models.find_model("smollm2-135m")


@pytest.fixture(scope="session")
def native(model_file: Path) -> Native:
    return Native(model_file, sequences=SEQUENCES, context=CONTEXT, threads=1, chunk=256)


@pytest.fixture
def engine(native: Native) -> Engine:
    """An engine whose context is empty."""
    for sequence in range(SEQUENCES):
        native.keep(sequence, 0)
    return Engine(native, sequences=SEQUENCES, context=CONTEXT)
