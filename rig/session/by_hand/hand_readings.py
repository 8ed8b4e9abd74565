"""Every reading there is while somebody works by hand, with the place it was read at, for whoever draws it."""

from collections import deque
from collections.abc import Callable
from itertools import islice
from typing import Any

from rig.devices.force.base import ForceError, ForceReading, ForceSensor
from rig.transport.base import TransportError

COLUMNS = ("unix_s", "t_s", "force_gwt", "x_mm", "y_mm", "z_mm", "height_mm")
KEPT = 3600
"""A little more than a minute of 50 a second."""

AT_A_TIME = 400
"""So many rows in an answer: it stays well below what the wire takes."""

Row = tuple[float | None, ...]


class OverheardSensor:
    """A force sensor whose every reading, or lack of one, is told, whoever asks for it."""

    def __init__(
        self, sensor: ForceSensor, told: Callable[[ForceReading], None], failed: Callable[[str], None]
    ) -> None:
        self._sensor, self._told, self._failed = sensor, told, failed

    def connect(self) -> str:
        """Make contact. Raises ForceError, TransportError."""
        return self._sensor.connect()

    def identify(self) -> str:
        """Who it is. Raises ForceError, TransportError."""
        return self._sensor.identify()

    def zero(self) -> None:
        """Take the present load for zero. Raises ForceError, TransportError."""
        self._sensor.zero()

    def close(self) -> None:
        """Give the port back."""
        self._sensor.close()

    @property
    def sample_period_s(self) -> float:
        """How often it has a new value."""
        return self._sensor.sample_period_s

    @property
    def resolution_gwt(self) -> float:
        """One step of what it shows."""
        return self._sensor.resolution_gwt

    def read(self) -> ForceReading:
        """The latest value. Raises ForceError, TransportError."""
        try:
            reading = self._sensor.read()
        except (ForceError, TransportError) as error:
            self._failed(str(error))
            raise
        self._told(reading)
        return reading


class Backlog:
    """The last KEPT readings, numbered from 0; written by one thread, read by others under the owner's lock."""

    def __init__(self) -> None:
        self._rows: deque[Row] = deque(maxlen=KEPT)
        self._told = 0

    def add(self, row: Row) -> None:
        """One reading, as COLUMNS."""
        self._rows.append(row)
        self._told += 1

    def since(self, number: int) -> dict[str, Any]:
        """Those from this number on (0: all that is kept), AT_A_TIME at most, and where to go on.

        more: there are some already. lost: so many were asked for too late.
        """
        first = self._told - len(self._rows)
        start = min(max(number, first), self._told)
        rows = list(islice(self._rows, start - first, start - first + AT_A_TIME))
        onward = start + len(rows)
        return {
            "columns": COLUMNS,
            "rows": rows,
            "next": onward,
            "more": onward < self._told,
            "lost": first - number if 0 < number < first else 0,
        }
