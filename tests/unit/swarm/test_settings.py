"""Settings: typed, from environment or file, and refused with name, value and what is allowed."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from swarm.errors import SettingError
from swarm.process import ProcessSettings
from swarm.settings import NAME_RULE, Name, Port, Seconds, Secret, load, shown


class Example(ProcessSettings, frozen=True, kw_only=True):
    ego: Name
    period_s: Seconds = 1.0
    port: Port = 1
    robots: tuple[Name, ...] = ()
    factor: float = 1.0


def example(**variables: str) -> Example:
    return load(Example, {"COADAPT_EGO": "R1", **variables})


def test_defaults_hold_where_nothing_is_set() -> None:
    settings = example()
    assert (settings.ego, settings.period_s, settings.swarm) == ("R1", 1.0, "local")


def test_variables_are_typed() -> None:
    settings = example(COADAPT_PERIOD_S="0.5", COADAPT_PORT="9100", COADAPT_ROBOTS="R1, R2,")
    assert (settings.period_s, settings.port, settings.robots) == (0.5, 9100, ("R1", "R2"))


def test_the_environment_wins_over_the_file(tmp_path: Path) -> None:
    file = tmp_path / "coadapt.toml"
    file.write_text('period_s = 2.0\nport = 7\nrobots = ["R1"]\n')
    settings = example(COADAPT_CONFIG=str(file), COADAPT_PORT="8")
    assert (settings.period_s, settings.port, settings.robots) == (2.0, 8, ("R1",))


@pytest.mark.parametrize(
    ("variable", "value", "allowed"),
    [
        ("COADAPT_PERIOD_S", "soon", "seconds > 0 and <= 3600"),
        ("COADAPT_PERIOD_S", "0", "seconds > 0 and <= 3600"),
        ("COADAPT_PERIOD_S", "nan", "seconds > 0 and <= 3600"),
        ("COADAPT_FACTOR", "inf", "finite"),
        ("COADAPT_FACTOR", "nan", "finite"),
        ("COADAPT_PORT", "65536", "a port >= 0 and <= 65535"),
        ("COADAPT_PORT", "", "a port >= 0 and <= 65535"),
        ("COADAPT_EGO", "R 1", NAME_RULE),
        ("COADAPT_EGO", "R1\n", NAME_RULE),
        ("COADAPT_ROBOTS", "R1,R/2", f"a list of {NAME_RULE}"),
        ("COADAPT_LOG_LEVEL", "loud", "one of debug, info, warning, error"),
    ],
)
def test_a_wrong_value_is_refused_with_name_value_and_what_is_allowed(
    variable: str, value: str, allowed: str
) -> None:
    with pytest.raises(SettingError) as caught:
        example(**{variable: value})
    for part in (variable, repr(value.split(",")[0])[1:-1], allowed):
        assert part in str(caught.value)


def test_a_wrong_value_in_the_file_is_refused_with_its_key(tmp_path: Path) -> None:
    file = tmp_path / "coadapt.toml"
    file.write_text("port = -1\n")
    with pytest.raises(SettingError, match=r"port = -1 .*a port >= 0 and <= 65535"):
        example(COADAPT_CONFIG=str(file))


def test_a_missing_setting_is_named_with_what_is_allowed() -> None:
    with pytest.raises(SettingError, match=f"COADAPT_EGO is not set; it must be {NAME_RULE}"):
        load(Example, {})


@pytest.mark.parametrize("content", ["port = = 1", None, b"\xff\xfe"])
def test_an_unreadable_file_is_named(tmp_path: Path, content: str | bytes | None) -> None:
    file = tmp_path / "coadapt.toml"
    if isinstance(content, bytes):
        file.write_bytes(content)
    elif content is not None:
        file.write_text(content)
    with pytest.raises(SettingError, match=r"COADAPT_CONFIG = .*coadapt\.toml"):
        example(COADAPT_CONFIG=str(file))


class Guarded(msgspec.Struct, kw_only=True):
    token: Secret = ""
    other: str = "seen"


def test_a_secret_is_told_by_nobody(tmp_path: Path) -> None:
    assert shown(load(Guarded, {"COADAPT_TOKEN": "hush"})) == "Guarded(token=***, other='seen')"
    path = tmp_path / "settings.toml"
    path.write_text('token = ["hush"]\n')
    with pytest.raises(SettingError, match=r"^COADAPT_TOKEN is not valid; it must be text$"):
        load(Guarded, {"COADAPT_CONFIG": str(path)})
