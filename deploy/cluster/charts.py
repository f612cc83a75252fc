"""The objects of `deploy.cluster.kubernetes` as files: a base for kustomize, and a chart for Helm.

The chart's templates are the same objects with a few values to choose. They use two forms only,
which a test can render without Helm: `{{ .Values.NAME }}`, and `{{ "{{" }}` for braces that mean
themselves.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml

from deploy.cluster import kubernetes
from deploy.cluster.plan import Cluster
from deploy.spec import SwarmSpec

BASE, CHART = "base", "chart"
CHART_VERSION = "1.0.0"
"""Of the chart's form: the values that it has."""


def documents(objects: Sequence[Mapping[str, Any]]) -> str:
    """Objects as YAML, one document each."""
    # Copied, so that nothing is the same thing twice: YAML would refer from one place to another.
    text: str = yaml.safe_dump_all(json.loads(json.dumps(objects)), sort_keys=False)
    return text


def base(spec: SwarmSpec, cluster: Cluster, monitoring: str) -> dict[str, str]:
    """A kustomization and its files, by name; `monitoring` as in `kubernetes.objects`."""
    objects = kubernetes.objects(spec, cluster, monitoring)
    files = {name: documents(own) for name, own in objects.items()}
    kustomization = {
        "apiVersion": "kustomize.config.k8s.io/v1beta1",
        "kind": "Kustomization",
        "resources": sorted(files),
    }
    return {"kustomization.yaml": documents([kustomization]), **files}


def chart(spec: SwarmSpec, cluster: Cluster, monitoring: str, version: str) -> dict[str, str]:
    """A Helm chart's files, by name; `version` is the project's."""
    values = {"image": cluster.image}
    if monitoring:
        values["monitoringNamespace"] = monitoring
    if cluster.llm_image:
        values["llmImage"] = cluster.llm_image
    names = {key: f"coadapt.invalid/{key.lower()}" for key in values}
    marked = replace(cluster, image=names["image"], llm_image=names.get("llmImage", ""))
    files = {}
    for name, own in kubernetes.objects(spec, marked, names.get("monitoringNamespace", "")).items():
        text = documents(own).replace("{{", '{{ "{{" }}')
        for key, mark in names.items():
            text = text.replace(mark, f"'{{{{ .Values.{key} }}}}'")
        files[f"templates/{name}"] = text
    about = {
        "apiVersion": "v2",
        "name": "coadapt-edge",
        "description": f"CoAdapt Edge swarm {spec.swarm} of {len(spec.robots)} robots",
        "type": "application",
        "version": CHART_VERSION,
        "appVersion": version,
    }
    return {"Chart.yaml": documents([about]), "values.yaml": documents([values]), **files}


def write(
    folder: Path, spec: SwarmSpec, cluster: Cluster, monitoring: str, version: str
) -> list[Path]:
    """Writes both below a folder, in place of what was there; returns their folders."""
    made = []
    both = {
        BASE: base(spec, cluster, monitoring),
        CHART: chart(spec, cluster, monitoring, version),
    }
    for name, files in both.items():
        target = folder / name
        shutil.rmtree(target, ignore_errors=True)
        for file, text in files.items():
            path = target / file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        made.append(target)
    return made
