"""Which router is taken of those that answer by multicast."""

from __future__ import annotations

import pytest

from swarm import scouting
from swarm.errors import SettingError

HERE = ["tls/127.0.0.1:7449?prio=6-7;rel=1", "tls/127.0.0.1:7447?prio=1-3;rel=1"]
NEAR, FAR = ["tls/198.51.100.1:7447?prio=1-3"], ["tls/198.51.100.2:7500", "tcp/198.51.100.2:7400"]


def found(monkeypatch: pytest.MonkeyPatch, *locators: str) -> str:
    monkeypatch.setattr(scouting, "_answers", lambda timeout_s: list(locators))
    return scouting.find_router("tls")


def test_the_only_one_is_taken_and_of_several_this_machines(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert found(monkeypatch, *NEAR, *NEAR) == "tls/198.51.100.1:7447"
    assert found(monkeypatch, *NEAR, *HERE, *FAR) == "tls/127.0.0.1:7447"


def test_none_and_too_many_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(SettingError, match="no router answers on this network by multicast"):
        found(monkeypatch, "tcp/198.51.100.1:7447", "unixsock-stream//run/x", "nonsense")
    with pytest.raises(
        SettingError, match=r"name one of them: tls/198.51.100.1:7447, tls/198.51.100.2"
    ):
        found(monkeypatch, *NEAR, *FAR)
