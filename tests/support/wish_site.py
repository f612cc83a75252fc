"""A site on which wishes are read by words alone, on a Monday at 14:05."""

from __future__ import annotations

from datetime import datetime

from llm_gateway.wishes import understand
from swarm.messages.intent import Intent, Site

NOW = datetime.fromisoformat("2026-11-23T14:05:00+01:00")


class WishSite:
    """Reads wishes on a site."""

    def __init__(self, robots: str, places: str, classes: str) -> None:
        """Names, separated by commas."""
        self.site = Site(
            robots=tuple(robots.split(", ")),
            places=tuple(places.split(", ")),
            classes=tuple(classes.split(", ")),
        )

    def understood(self, wish: str) -> Intent:
        """What is read of a wish."""
        return understand(wish, self.site, NOW, None)

    def clear(self, wish: str) -> Intent:
        """The same of one that is understood as a whole."""
        intent = self.understood(wish)
        assert intent.unclear == (), wish
        return intent

    def weights(self, wish: str) -> dict[str, str]:
        """What one that is understood as a whole says of places and classes."""
        intent = self.clear(wish)
        return {**{f.place: f.weight for f in intent.focus}, **intent.classes}
