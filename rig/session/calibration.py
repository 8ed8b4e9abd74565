"""Calibrations: which may still be used today, and what a measurement makes of them."""

import datetime
from collections.abc import Iterator

import tomlkit

from rig.plan.config import Config
from rig.protocol.errors import BadInputError
from rig.transport.clock import WallClock


def today() -> datetime.date:
    """The day at the bench."""
    return datetime.datetime.fromtimestamp(WallClock().unix_s()).date()


def expired_calibrations(config: Config) -> list[str]:
    """One line for each calibration that may no longer be used: refused on hardware, a warning in a dry-run."""
    return [str(problem) for problem in _expired(config)]


def refuse_expired(config: Config) -> None:
    """Raises BadInputError for a calibration that may no longer be used."""
    for problem in _expired(config):
        raise problem


def _expired(config: Config) -> Iterator[BadInputError]:
    for name in config.calibration.expired(today()):
        expires = getattr(config.calibration, name).expires
        yield BadInputError("{key}: expired on {expires}, expected a newer measurement", code="expired",
                            key=f"calibration.{name}", expires=expires)  # fmt: skip


def as_table(name: str, value: float, valid_days: int, sd: float | None = None) -> str:
    """A calibration made today, as lines for the configuration file."""
    date = today()
    expires = date + datetime.timedelta(days=valid_days)
    known_to = {} if sd is None else {"sd": tomlkit.value(f"{sd:.3g}")}
    table = {"value": tomlkit.value(f"{value:.6g}"), **known_to, "date": date, "expires": expires}
    return tomlkit.dumps({"calibration": {name: table}})
