"""Which tab has the controls: one at a time, and for as long as it is there."""

from collections import Counter

GONE_S = 5.0
"""A tab that looks on no more and asks for nothing for so long has left."""


class Tabs:
    """The tabs that look on, and the one that has the controls."""

    def __init__(self) -> None:
        self.holder: str | None = None
        self._looking: Counter[str] = Counter()
        self._heard_s = 0.0
        self._released = 0

    def opened(self, tab: str) -> None:
        """It looks on."""
        self._looking[tab] += 1

    def closed(self, tab: str, now_s: float) -> None:
        """It does so no more."""
        self._looking[tab] -= 1
        if self._looking[tab] <= 0:
            del self._looking[tab]
        if tab == self.holder:
            self._heard_s = now_s

    def take(self, tab: str, now_s: float) -> None:
        """The controls are its own from here on."""
        if tab != self.holder:
            self._released = 0
        self.holder, self._heard_s = tab, now_s

    def may(self, tab: str, now_s: float) -> bool:
        """Whether a tab has the controls; the first one that asks for something gets them."""
        if self.holder is None:
            self.take(tab, now_s)
        if tab == self.holder:
            self._heard_s = now_s
        return tab == self.holder

    def look(self, now_s: float) -> None:
        """Whoever has left gives the controls back."""
        if self.holder is not None and self.holder not in self._looking and now_s - self._heard_s > GONE_S:
            self.holder = None

    def release(self, press: int) -> None:
        """A button was let go; nothing more comes of what was pressed before."""
        self._released = max(self._released, press)

    def is_released(self, press: int) -> bool:
        """Whether that button was let go."""
        return press <= self._released
