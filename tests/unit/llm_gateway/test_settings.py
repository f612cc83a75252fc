"""Settings of the gateway: what is wrong is named, and secrets are never shown."""

from __future__ import annotations

from pathlib import Path

import pytest

from llm_gateway.backends.registry import make_backend
from llm_gateway.settings import load_settings
from swarm.errors import SettingError
from swarm.log import make_logger

KEY = "sk-very-secret"


def settings(**values: str) -> dict[str, str]:
    return {f"COADAPT_LLM_{name}": value for name, value in values.items()}


def test_the_key_comes_from_the_environment_or_a_file_and_is_never_shown(tmp_path: Path) -> None:
    file = tmp_path / "key"
    file.write_text(f"{KEY}\n")
    for loaded in (
        load_settings(settings(API_KEY=KEY, HTTP_TOKEN="t0ken")),
        load_settings(settings(API_KEY_FILE=str(file), HTTP_TOKEN="t0ken")),
    ):
        assert loaded.llm_api_key == KEY
        for shown in (repr(loaded), str(loaded), f"{loaded}"):
            assert KEY not in shown
            assert "t0ken" not in shown
        assert "llm_api_key='***'" not in repr(loaded)
        assert "llm_api_key=***" in repr(loaded)
    assert "llm_api_key=''" in repr(load_settings({}))


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"", "holds no key"),
        (b" \n", "holds no key"),
        (b"two words", "holds no key"),
        (b"\xff\xfe\x00", "holds no key"),
        (KEY.encode() + b"\x00", "holds no key"),
        (None, "cannot be read: No such file"),
    ],
)
def test_a_file_without_a_key_ends_the_process(
    tmp_path: Path, content: bytes | None, told: str
) -> None:
    file = tmp_path / "key"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(SettingError, match=f"COADAPT_LLM_API_KEY_FILE.*{told}") as caught:
        load_settings(settings(API_KEY_FILE=str(file)))
    assert KEY not in str(caught.value)


def test_a_key_in_two_places_or_of_the_wrong_kind_is_refused_unseen(tmp_path: Path) -> None:
    with pytest.raises(SettingError, match="are both set") as caught:
        load_settings(settings(API_KEY=KEY, API_KEY_FILE="/nowhere"))
    assert KEY not in str(caught.value)
    with pytest.raises(SettingError, match="COADAPT_LLM_API_KEY is not valid") as caught:
        load_settings(settings(API_KEY=f"{KEY} and more"))
    assert KEY not in str(caught.value)
    toml = tmp_path / "settings.toml"
    toml.write_text("llm_api_key = [1234567]\n")
    with pytest.raises(SettingError, match="COADAPT_LLM_API_KEY is not valid") as caught:
        load_settings({"COADAPT_CONFIG": str(toml)})
    assert "1234567" not in str(caught.value)


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"QUEUE": "0"}, "COADAPT_LLM_QUEUE = '0'"),
        ({"WINDOW_MS": "-1"}, "COADAPT_LLM_WINDOW_MS"),
        ({"CACHE_TTL_S": "nan"}, "COADAPT_LLM_CACHE_TTL_S"),
    ],
)
def test_what_is_out_of_range_is_named(values: dict[str, str], told: str) -> None:
    with pytest.raises(SettingError, match=told):
        load_settings(settings(**values))


def test_a_back_end_is_made_by_name() -> None:
    log = make_logger("test", level="error")
    assert make_backend(load_settings({}), log).name == "none"
    with pytest.raises(SettingError, match=r"'oracle' .* allowed: llamacpp, none, openai"):
        make_backend(load_settings(settings(BACKEND="oracle")), log)
    with pytest.raises(SettingError, match=r"COADAPT_LLM_TRAINED = true does not go with .*'m'"):
        make_backend(load_settings(settings(BACKEND="llamacpp", MODEL="m", TRAINED="true")), log)
    chosen = settings(BACKEND="openai", URL="http://127.0.0.1:9/v1", MODEL="m")
    assert make_backend(load_settings(chosen), log).model == "m"
    with pytest.raises(SettingError, match="COADAPT_LLM_URL") as caught:
        make_backend(
            load_settings(settings(BACKEND="openai", URL=f"http://u:{KEY}@127.0.0.1/v1")), log
        )
    assert KEY not in str(caught.value)
