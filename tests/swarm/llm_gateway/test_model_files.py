"""Model files that packages carry, whole or in parts."""

from pathlib import Path

import pytest

from llm_gateway.backends.llamacpp.models import PACKAGES, find_model, installed_models
from swarm.errors import SettingError

pytestmark = pytest.mark.model

NAME = "gemma3-270m"


def carry_parts(folder: Path, numbers: list[str]) -> None:
    for package, number in zip(PACKAGES[NAME][1:], numbers, strict=False):
        data = folder / package / "data"
        data.mkdir(parents=True)
        (data.parent / "__init__.py").touch()
        (data / f"model.gguf.part{number}").write_bytes(b"GGUF" if number == "00" else b"+more")


@pytest.fixture
def packages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "site"


def test_parts_in_several_packages_are_one_model(packages: Path) -> None:
    carry_parts(packages, ["00", "01", "02"])
    assert NAME in installed_models()
    whole = find_model(NAME)
    assert whole.read_bytes() == b"GGUF+more+more"
    assert find_model(NAME) == whole
    assert [p.name for p in whole.parent.iterdir()] == [whole.name]


def test_a_missing_part_is_named(packages: Path) -> None:
    carry_parts(packages, ["00", "02"])
    with pytest.raises(SettingError, match=r"model\.gguf are missing; there are 00, 02"):
        find_model(NAME)
