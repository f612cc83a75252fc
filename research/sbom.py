"""The software bill of materials (`make sbom`): build/sbom.json, CycloneDX 1.6.

CycloneDX' own tool lists the packages of the environment with versions and licences. Here comes
what only the repository knows: which of them the locks say run (`scope` required), which only the
embedded model needs (optional) and which only check and draw (excluded); and the Debian packages of
an image. The same environment gives the same bytes.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from urllib.parse import quote

from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

REPOSITORY = Path(__file__).resolve().parents[1]
OUTPUT = REPOSITORY / "build" / "sbom.json"
PROJECT = "coadapt-edge"
REQUIRED = ("requirements.lock", "requirements-torch.lock")
OPTIONAL = ("requirements-llm.lock",)
EXCLUDED = ("requirements-dev.lock",)

Component = dict[str, Any]
Document = dict[str, Any]


class SbomError(Exception):
    """The bill cannot be made, or would not be true."""


def plain(name: str) -> str:
    """A package's name as indexes compare it."""
    return str(canonicalize_name(name))


def pins(*locks: str) -> dict[str, str]:
    """Version by name of the packages that locks pin for this Python and machine."""
    found: dict[str, str] = {}
    for lock in locks:
        text = (REPOSITORY / lock).read_text()
        for line in re.findall(r"^[A-Za-z0-9].*?==[^\\\n]+", text, re.MULTILINE):
            one = Requirement(line.strip())
            if one.marker is None or one.marker.evaluate():
                (version,) = one.specifier
                found[plain(one.name)] = version.version
    return found


def environment(python: str) -> Document:
    """What CycloneDX' tool finds in an environment. Raises SbomError with its words."""
    done = subprocess.run(
        [
            *(sys.executable, "-m", "cyclonedx_py", "environment", "--output-reproducible"),
            *("--of", "JSON", "--sv", "1.6", "--pyproject", str(REPOSITORY / "pyproject.toml")),
            python,
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        raise SbomError(f"cyclonedx-py failed ({done.returncode}): {done.stderr.strip()}")
    document: Document = json.loads(done.stdout)
    return document


def complete(document: Document, debian: list[Component]) -> Document:
    """The document with scopes and Debian packages, and the project once: as what all of it is for.

    Raises SbomError for a package that a lock pins and the environment lacks or has otherwise.
    """
    components = [one for one in document["components"] if one["name"] != PROJECT]
    there = {plain(one["name"]): one["version"] for one in components}
    _check(there, pins(*REQUIRED, *EXCLUDED))
    required, optional = pins(*REQUIRED), pins(*OPTIONAL)
    for one in components:
        name = plain(one["name"])
        one["scope"] = (
            "required" if name in required else "optional" if name in optional else "excluded"
        )
        # A folder of wheels lies elsewhere on another machine.
        references = one.get("externalReferences", [])
        kept = [place for place in references if not place["url"].startswith("file:")]
        if len(kept) < len(references):
            one["externalReferences"] = kept
    root = document["metadata"]["component"]
    its = {f"{PROJECT}=={root['version']}", root["bom-ref"]}
    needed = {
        need
        for one in document["dependencies"]
        if one["ref"] in its
        for need in one.get("dependsOn", ())
    }
    dependencies = [one for one in document["dependencies"] if one["ref"] not in its]
    dependencies.append({"ref": root["bom-ref"], "dependsOn": sorted(needed - its)})
    return {
        **document,
        "components": [*components, *debian],
        "dependencies": sorted(dependencies, key=lambda one: str(one["ref"])),
    }


def debian_packages(before: list[str]) -> list[Component]:
    """The Debian packages where `dpkg-query` runs; `before`: what runs it in a container.

    Raises SbomError.
    """
    form = "${Package}\t${Version}\t${Architecture}\n"
    try:
        done = subprocess.run(
            [*before, "dpkg-query", "--show", f"--showformat={form}"],
            capture_output=True,
            text=True,
            check=False,
        )
    except OSError as error:
        raise SbomError(f"{before[0] if before else 'dpkg-query'} does not run: {error}") from error
    if done.returncode != 0:
        raise SbomError(f"Debian's packages cannot be listed: {done.stderr.strip()}")
    found = []
    for line in sorted(set(done.stdout.splitlines())):
        name, version, machine = line.split("\t")
        purl = f"pkg:deb/debian/{quote(name)}@{quote(version, safe='')}?arch={machine}"
        found.append(
            {
                **{"type": "library", "bom-ref": purl, "name": name, "version": version},
                **{"purl": purl, "scope": "required"},
            }
        )
    return found


def text_of(document: Document) -> str:
    """The bytes of build/sbom.json."""
    return json.dumps(document, indent=2, sort_keys=True) + "\n"


def validate(text: str) -> None:
    """Raises SbomError when CycloneDX' schema refuses a text."""
    fault = JsonStrictValidator(SchemaVersion.V1_6).validate_str(text)
    if fault is not None:
        raise SbomError(f"the bill does not follow CycloneDX 1.6: {fault}")


def _check(there: Mapping[str, str], pinned: Mapping[str, str]) -> None:
    # PyTorch's build for the processor calls itself 2.13.0+cpu.
    wrong = {
        name: version
        for name, version in pinned.items()
        if there.get(name, "").partition("+")[0] != version
    }
    if wrong:
        some = ", ".join(
            f"{name} {there.get(name, 'missing')} instead of {version}"
            for name, version in sorted(wrong.items())[:5]
        )
        raise SbomError(f"the environment is not what the locks pin: {some}; run make setup")


def main(arguments: list[str] | None = None) -> int:
    """Writes the file; returns 1 with a sentence when it cannot."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--python", default=sys.executable, help="of the environment")
    parser.add_argument("--image", help="also lists the Debian packages of this Docker image")
    parser.add_argument("--output", type=Path, default=OUTPUT)
    args = parser.parse_args(arguments)
    inside = ["docker", "run", "--rm", "--network=none", "--entrypoint=", str(args.image)]
    try:
        debian = debian_packages(inside) if args.image else []
        text = text_of(complete(environment(args.python), debian))
        validate(text)
    except SbomError as error:
        print(f"sbom: {error}", file=sys.stderr)
        return 1
    args.output.parent.mkdir(parents=True, exist_ok=True)
    args.output.write_text(text)
    print(f"sbom: {len(json.loads(text)['components'])} components in {args.output}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
