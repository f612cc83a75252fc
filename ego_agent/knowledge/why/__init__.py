"""Why a decision was made, told from the journal alone."""

from ego_agent.knowledge.why.compose import Explanation, explain
from ego_agent.knowledge.why.find import Follower, Found, find

__all__ = ["Explanation", "Follower", "Found", "explain", "find"]
