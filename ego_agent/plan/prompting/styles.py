"""Prompts by name: what an ego may be set to ask with."""

from __future__ import annotations

from typing import Protocol, get_args

from ego_agent.knowledge.base import CycleResult, Knowledge
from ego_agent.knowledge.model import UnifiedScene
from ego_agent.plan.choices.scoring import Scorer
from ego_agent.plan.prompting.paper import make_paper_prompt
from ego_agent.plan.prompting.prompt import LlmPrompt, make_prompt
from ego_agent.plan.prompting.short import make_short_prompt
from ego_agent.settings import PromptStyle
from swarm.messages import Decision

STYLES: tuple[PromptStyle, ...] = get_args(PromptStyle)


class MakesPrompt(Protocol):
    """As `make_prompt`."""

    def __call__(
        self,
        scene: UnifiedScene,
        knowledge: Knowledge,
        previous: Decision | None,
        result: CycleResult | None,
        *,
        scorer: Scorer | None = None,
    ) -> LlmPrompt:
        """The question that a scene poses."""
        ...


def prompt_maker(style: PromptStyle) -> MakesPrompt:
    """Who makes prompts of that style."""
    makers: dict[PromptStyle, MakesPrompt] = {
        "table": make_prompt,
        "paper": make_paper_prompt,
        "short": make_short_prompt,
    }
    return makers[style]
