"""Policies by name: every module of this package that has `POLICIES` adds them.

To add a policy, add one file here with a class and `POLICIES = (MyPolicy,)`; no list needs to be
changed. What stands there is called without arguments for every use, so that a policy may have
state of its own.
"""

from __future__ import annotations

from collections.abc import Sequence

from ego_agent.plan.policies.base import Policy, Requiring
from swarm.errors import DecisionError
from swarm.registry import by_name, registered


def _all_policies() -> dict[str, Policy]:
    made = (make() for make in registered("POLICIES", "ego_agent.plan.policies"))
    return by_name(made, "policies", DecisionError)


def policy_names() -> tuple[str, ...]:
    """The names of all policies, sorted."""
    return tuple(_all_policies())


def make_policy(name: str, algorithms: Sequence[str]) -> Policy:
    """A new policy of that name, for a swarm that can fuse with the given algorithms.

    >>> make_policy("static-late", ["early", "late"]).name
    'static-late'

    Raises DecisionError for an unknown name, and for a policy whose algorithm is not available.
    """
    found = _all_policies()
    if name not in found:
        raise DecisionError(f"policy {name!r} is unknown; allowed: {', '.join(found)}")
    policy = found[name]
    if isinstance(policy, Requiring) and policy.requires not in algorithms:
        raise DecisionError(
            f"policy {name!r} needs {policy.requires} fusion, which is not available; "
            f"available: {', '.join(algorithms)}"
        )
    return policy
