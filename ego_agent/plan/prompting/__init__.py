"""A scene as a question to a language model, and its answer as advice."""

from ego_agent.plan.prompting.answer import Advice, read_answer
from ego_agent.plan.prompting.fingerprint import fingerprint
from ego_agent.plan.prompting.prompt import LlmPrompt, make_prompt
from ego_agent.plan.prompting.styles import STYLES, prompt_maker

__all__ = [
    "STYLES", "Advice", "LlmPrompt", "fingerprint", "make_prompt", "prompt_maker",
    "read_answer",
]  # fmt: skip
