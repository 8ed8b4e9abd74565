"""Which runs are asked for, of those that there are."""

from dataclasses import dataclass
from datetime import date

from rig.data.summary import Summary


@dataclass(frozen=True)
class Wanted:
    """Which runs are asked for; None is all of them."""

    subject: str | None = None
    shape: str | None = None
    protocol: str | None = None
    state: str | None = None
    since: date | None = None
    until: date | None = None

    def has(self, run: Summary) -> bool:
        """Whether it is one of them; a shape is meant with and without what stands behind its colon."""
        named = ((self.subject, run.subject), (self.protocol, run.protocol), (self.state, run.state))
        if any(wanted not in (None, found) for wanted, found in named):
            return False
        if self.shape is not None and not any(self.shape in (one, one.partition(":")[0]) for one in run.shapes):
            return False
        day = date.fromisoformat(run.date_utc[:10])
        return (self.since is None or day >= self.since) and (self.until is None or day <= self.until)
