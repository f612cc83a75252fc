"""Operators' intents in decisions: in one place for all policies.

Before a policy: the scene without the robots that are left out, what is seen weighed, the objective
with its limits.
After it: Q_min, which a policy may have missed.
"""
