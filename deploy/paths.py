"""Where a swarm's files lie in its `var_dir`."""

from __future__ import annotations

import time

from deploy.spec import SwarmSpec
from swarm.trust.identity import CA, ISSUED

JOURNAL = "journal"
NET = "net"
"""The controller's part of `var_dir`."""
LLM = "llm"
"""The gateway's."""
RECORDINGS = "recordings"
"""Where `coadapt record` writes; the console shows it."""
SITE = "site"
"""Names of the site's places, which the console may change: a folder, for a file that is replaced
is not seen through a mount of its own."""
KEYSTORE = "keystore"
"""A secure swarm's certificates (`deploy.trust.keystore`)."""
TARGETS = "targets"
"""Where the router tells Prometheus of processes that joined: a folder, for a file that is replaced
is not seen through a mount of its own."""
FOLDERS = (JOURNAL, NET, LLM, RECORDINGS, SITE, TARGETS, "prometheus")


def identity_path(var_dir: str, common_name: str) -> str:
    """Where a role's identity lies, as the processes see it."""
    return f"{var_dir}/{KEYSTORE}/{ISSUED}/{common_name}"


def authority_path(var_dir: str) -> str:
    """Where the certificate of a swarm's authority lies."""
    return f"{var_dir}/{KEYSTORE}/ca/{CA}"


def site_path(var_dir: str) -> str:
    """Where the site file lies that a swarm uses."""
    return f"{var_dir}/{SITE}/site.json"


def journal_path(spec: SwarmSpec, var_dir: str, ego: str = "") -> str:
    """An ego's journal: one file for each time that the swarm is started, named by when."""
    return f"{var_dir}/{JOURNAL}/{ego or spec.ego}-{begun(spec)}.jsonl"


def net_journal_path(spec: SwarmSpec, var_dir: str) -> str:
    """The controller's journal of actions."""
    return f"{var_dir}/{NET}/actions-{begun(spec)}.jsonl"


def begun(spec: SwarmSpec) -> str:
    """When the swarm was started (UTC), as file names tell it."""
    return time.strftime("%Y%m%dT%H%M%SZ", time.gmtime(spec.epoch_ns // 1_000_000_000))
