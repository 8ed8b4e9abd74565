"""The bench by hand as a page is told of it: by what its owner answers, and by the configuration of the panel."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rig.devices.bench_settings import BenchSettings
from rig.devices.units import GWT_N
from rig.panel.drawn.job import Job
from rig.panel.outlet import Row, Source
from rig.panel.seen.ages import age_s
from rig.panel.seen.limits_told import limits_told
from rig.plan.config import Config

COLUMNS = ("unix_s", "t_s", "force_gwt", "x_mm", "y_mm", "z_mm", "height_mm")
HAND = Source(None, COLUMNS, hand=True)


class SeenBench:
    """What was last heard of by hand; nothing where nobody has the bench."""

    def __init__(self, path: Path | None = None, config: Config | None = None) -> None:
        self.path, self._config = path, config
        self._status: Mapping[str, Any] = {}
        self.owner: int | None = None
        self.since = 0  # its first reading that was not told yet

    def begin(self, owner: int) -> None:
        """A process has the bench from here on."""
        self.owner, self.since, self._status = owner, 0, {}

    def since_of(self, owner: int) -> int:
        """Where a process's readings begin that were not told yet."""
        return self.since if owner == self.owner else 0

    @property
    def configured(self) -> bool:
        """Whether there is a bench that could be taken."""
        return self._config is not None

    @property
    def settings(self) -> BenchSettings | None:
        """Of its devices; None where there is no bench that could be taken."""
        return self._config

    @property
    def ports(self) -> tuple[str, ...]:
        """Of its devices."""
        return () if self._config is None else (*self._config.stage.ports, self._config.force.port)

    @property
    def job(self) -> Job | None:
        """The finger alone: what is mounted nobody knows."""
        return None if self.path is None else Job(self.path)

    def heard(self, status: Mapping[str, Any] | None) -> list[Row]:
        """What the owner answered, None where it did not; returns the readings in it, which are new."""
        if status is None:
            return []
        self._status = status
        new = status.get("readings")
        if new is None:
            return []
        self.since = new["next"]
        places = [new["columns"].index(name) for name in COLUMNS]
        return [[row[place] for place in places] for row in new["rows"]]

    def newest_told(self, unix_s: float) -> dict[str, Any]:
        """`newest` of the state."""
        status = self._status
        force_gwt, read_s = status.get("force_gwt"), status.get("read_unix_s")
        return {
            "force_gwt": force_gwt,
            "force_n": None if force_gwt is None else force_gwt * GWT_N,
            "doi_mm": None,
            "x_mm": status.get("x_mm"),
            "height_mm": status.get("height_mm"),
            "phase": status.get("busy"),
            "t_s": read_s,
            "age_s": age_s(read_s, unix_s),
        }

    def devices_told(self, unix_s: float) -> dict[str, Any]:
        """`devices` of the state."""
        status = self._status
        force = "not heard of" if status.get("force_gwt") is None else "zeroed" if status.get("zeroed") else "reads"
        return {
            "stage": {
                "word": status.get("stage_problem") or status.get("state", "not heard of"),
                "homed": bool(status.get("homed")),
                "age_s": age_s(status.get("seen_unix_s"), unix_s),
            },
            "force": {
                "word": status.get("force_problem") or force,
                "age_s": age_s(status.get("read_unix_s"), unix_s),
            },
        }

    def limits_told(self) -> dict[str, Any] | None:
        """`limits` of the state."""
        return None if self._config is None else limits_told(self._config, None, self._status.get("force_gwt"))
