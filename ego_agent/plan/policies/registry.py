"""Policies by name: every module of this package that has `POLICIES` adds them.

To add a policy, add one file here with a class and `POLICIES = (MyPolicy,)`; no list needs to be
changed. What stands there is called without arguments for every use, so that a policy may have
state of its own.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Sequence

import ego_agent.plan.policies as policies
from ego_agent.plan.policies.base import Policy, Requiring
from swarm.errors import DecisionError


def _all_policies() -> dict[str, Policy]:
    found: dict[str, Policy] = {}
    for module in sorted(m.name for m in pkgutil.iter_modules(policies.__path__)):
        loaded = importlib.import_module(f"{policies.__name__}.{module}")
        for make in getattr(loaded, "POLICIES", ()):
            policy: Policy = make()
            if policy.name in found:
                raise DecisionError(f"two policies are called {policy.name!r}")
            found[policy.name] = policy
    return found


def policy_names() -> tuple[str, ...]:
    """The names of all policies, sorted."""
    return tuple(sorted(_all_policies()))


def make_policy(name: str, algorithms: Sequence[str]) -> Policy:
    """A new policy of that name, for a swarm that can fuse with the given algorithms.

    >>> make_policy("static-late", ["early", "late"]).name
    'static-late'

    Raises DecisionError for an unknown name, and for a policy whose algorithm is not available.
    """
    found = _all_policies()
    if name not in found:
        raise DecisionError(f"policy {name!r} is unknown; allowed: {', '.join(sorted(found))}")
    policy = found[name]
    if isinstance(policy, Requiring) and policy.requires not in algorithms:
        raise DecisionError(
            f"policy {name!r} needs {policy.requires} fusion, which is not available; "
            f"available: {', '.join(algorithms)}"
        )
    return policy
