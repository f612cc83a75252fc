"""Who may come in, and where the token comes from."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

import llm_gateway.settings
import network_controller.settings
import options.console.settings
from swarm.errors import SettingError
from swarm.http.access import Access

TOKEN = "t0ken-of-a-test"
Load = Callable[[dict[str, str]], msgspec.Struct]
LOADS: dict[str, Load] = {
    "QOD_TOKEN": network_controller.settings.load_settings,
    "LLM_HTTP_TOKEN": llm_gateway.settings.load_settings,
    "CONSOLE_TOKEN": lambda values: options.console.settings.load_settings(
        values | {"COADAPT_EGO": "R1"}
    ),
}


@pytest.mark.parametrize("name", LOADS)
def test_a_token_comes_from_the_environment_or_a_file_and_is_never_shown(
    tmp_path: Path, name: str
) -> None:
    file = tmp_path / "token"
    file.write_text(f"{TOKEN}\n")
    for given in ({f"COADAPT_{name}": TOKEN}, {f"COADAPT_{name}_FILE": str(file)}):
        settings = LOADS[name](given)
        assert getattr(settings, name.lower()) == TOKEN
        assert TOKEN not in repr(settings)
    assert getattr(LOADS[name]({}), name.lower()) == ""


@pytest.mark.parametrize("name", LOADS)
@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"", "holds no token"),
        (b" \n", "holds no token"),
        (b"\xff\xfe", "holds no token"),
        (b"two words", "is not valid"),
        (b"s3cret\r\nX: y", "is not valid"),
        (None, "cannot be read: No such file"),
    ],
)
def test_a_file_without_a_token_ends_the_process_and_opens_nothing(
    tmp_path: Path, name: str, content: bytes | None, told: str
) -> None:
    file = tmp_path / "token"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(SettingError, match=f"COADAPT_{name}_FILE = .*{told}") as caught:
        LOADS[name]({f"COADAPT_{name}_FILE": str(file)})
    assert "s3cret" not in str(caught.value)


@pytest.mark.parametrize("name", LOADS)
def test_a_token_in_two_places_is_refused(name: str) -> None:
    with pytest.raises(SettingError, match="are both set") as caught:
        LOADS[name]({f"COADAPT_{name}": TOKEN, f"COADAPT_{name}_FILE": "/nowhere"})
    assert TOKEN not in str(caught.value)


@pytest.mark.parametrize(
    ("listens", "asked", "refused"),
    [
        ("127.0.0.1", "127.0.0.1:80", ""),
        ("127.0.0.1", "10.0.0.1", "name"),
        ("0.0.0.0", "10.0.0.1", ""),
        ("0.0.0.0", "evil.example", "name"),
        ("0.0.0.0", "qod.plant", ""),
        ("127.0.0.1", "QOD.plant:443", ""),
    ],
)
@pytest.mark.parametrize("token", ["", TOKEN])
def test_the_name_counts_with_a_token_and_without(
    listens: str, asked: str, refused: str, token: str
) -> None:
    access = Access(listens, token, ["qod.plant"])
    shown = {"host": asked, "authorization": f"Bearer {TOKEN}"}
    assert access.refusal(shown) == refused


def test_the_token_is_asked_for_where_something_is_shown() -> None:
    access = Access("127.0.0.1", TOKEN)
    assert access.refusal({"host": "localhost"}) == "token"
    assert access.refusal({"host": "localhost", "authorization": "Bearer x"}) == "token"
    assert access.refusal({"host": "localhost"}, without_token=True) == ""
    assert access.refusal({"host": "evil.example"}, without_token=True) == "name"
