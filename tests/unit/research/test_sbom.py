"""The software bill of materials names what the locks pin, and follows its schema."""

from __future__ import annotations

import copy
import json
import shutil
import sys
from pathlib import Path
from typing import Any

import pytest

from research import sbom

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def listed() -> sbom.Document:
    """What CycloneDX' tool finds where the tests run; it takes some seconds."""
    return sbom.environment(sys.executable)


@pytest.fixture(scope="module")
def bill(listed: sbom.Document) -> Any:
    return json.loads(sbom.text_of(sbom.complete(copy.deepcopy(listed), [])))


def versions(document: Any) -> dict[str, str]:
    return {
        sbom.plain(one["name"]): one["version"].partition("+")[0] for one in document["components"]
    }


def test_every_package_of_the_locks_is_in_it_with_its_version(bill: Any) -> None:
    pinned = sbom.pins(*sbom.REQUIRED, *sbom.EXCLUDED)
    assert len(pinned) > 100
    assert pinned.items() <= versions(bill).items()


def test_scopes_tell_what_runs_from_what_checks(bill: Any) -> None:
    scopes = {sbom.plain(one["name"]): one["scope"] for one in bill["components"]}
    assert {scopes["torch"], scopes["eclipse-zenoh"]} == {"required"}
    assert {scopes["pytest"], scopes["cyclonedx-bom"]} == {"excluded"}


def test_the_project_is_the_root_with_its_licence_and_stands_there_once(bill: Any) -> None:
    root = bill["metadata"]["component"]
    assert root["name"] == "coadapt-edge"
    assert root["licenses"][0]["license"]["id"] == "Apache-2.0"
    assert "coadapt-edge" not in versions(bill)
    (its,) = (one for one in bill["dependencies"] if one["ref"] == root["bom-ref"])
    assert any(ref.startswith("eclipse-zenoh==") for ref in its["dependsOn"])


def test_packages_have_licences_and_no_place_on_this_machine(bill: Any) -> None:
    without = [one["name"] for one in bill["components"] if not one.get("licenses")]
    assert len(without) < 0.05 * len(bill["components"])
    assert "file://" not in json.dumps(bill)


@pytest.mark.slow
def test_the_same_environment_gives_the_same_bytes(listed: sbom.Document) -> None:
    again = sbom.environment(sys.executable)
    once, twice = (sbom.complete(copy.deepcopy(one), []) for one in (listed, again))
    assert sbom.text_of(once) == sbom.text_of(twice)


def test_the_schema_holds_it_and_refuses_a_wrong_one(bill: Any) -> None:
    sbom.validate(sbom.text_of(bill))
    wrong = {**bill, "components": [{**bill["components"][0], "scope": "perhaps"}]}
    with pytest.raises(sbom.SbomError, match="does not follow CycloneDX"):
        sbom.validate(sbom.text_of(wrong))


def test_an_environment_with_another_version_is_refused(listed: sbom.Document) -> None:
    other = copy.deepcopy(listed)
    (numpy,) = (one for one in other["components"] if one["name"] == "numpy")
    numpy["version"] = "1.0"
    with pytest.raises(sbom.SbomError, match=r"numpy 1\.0 instead of .*; run make setup"):
        sbom.complete(other, [])


def test_an_environment_that_is_not_there_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "sbom.json"
    assert sbom.main(["--python", str(tmp_path / "none"), "--output", str(output)]) == 1
    assert "cyclonedx-py failed" in capsys.readouterr().err
    assert not output.exists()


@pytest.mark.skipif(shutil.which("dpkg-query") is None, reason="no Debian")
def test_debian_packages_are_components_of_their_own(listed: sbom.Document) -> None:
    packages = sbom.debian_packages([])
    (its,) = (one for one in packages if one["name"] == "dpkg")
    assert its["purl"].startswith("pkg:deb/debian/dpkg@1.")
    document = sbom.complete(copy.deepcopy(listed), packages[:3])
    assert document["components"][-3:] == packages[:3]


def test_a_container_that_does_not_run_is_told() -> None:
    with pytest.raises(sbom.SbomError, match="no-such-program does not run"):
        sbom.debian_packages(["no-such-program"])
