"""ETSI's ASN.1 modules: which files are taken, and what is said where they are missing."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from options.etsi import modules
from swarm.errors import SettingError


def test_another_file_than_expected_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COADAPT_DATA", str(tmp_path / "data"))
    source = tmp_path / "source"
    for name in modules.FILES:
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        (source / name).write_text("DEFINITIONS")
    with pytest.raises(SettingError, match="is another file than expected: SHA-256"):
        modules.bring(source.as_uri())
    assert not modules.folder().exists()
    assert not modules.are_there()


def test_what_cannot_be_had_says_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COADAPT_DATA", str(tmp_path))
    with pytest.raises(SettingError, match="Where there is no network, bring the folder"):
        modules.bring((tmp_path / "nowhere").as_uri())


def test_right_files_are_put_in_place_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COADAPT_DATA", str(tmp_path / "data"))
    (tmp_path / "a.asn").write_text("A")
    files = {"a.asn": hashlib.sha256(b"A").hexdigest()}
    monkeypatch.setattr(modules, "FILES", files)
    folder = modules.bring(tmp_path.as_uri())
    assert (folder / "a.asn").read_text() == "A"
    assert modules.are_there()
    # Nothing is brought again.
    assert modules.bring("file:///nowhere") == folder


def test_modules_of_another_make_are_named() -> None:
    with pytest.raises(SettingError, match="0 times in the modules; expected: once"):
        modules.said_otherwise(["A DEFINITIONS ::= BEGIN END"])
