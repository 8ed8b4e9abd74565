"""File of an identified finger: part of a configuration, with the result of the identification and its sources.

Tables: `[finger]` the most likely finger within the bands, `[virtual]` its relaxation, `[identified]` the rest.
"""

import hashlib
import json
import logging
import math
import tomllib
from functools import cache
from pathlib import Path
from statistics import fmean
from typing import Any, Self

import tomlkit
from pydantic import Field, ValidationError, field_validator, model_validator

import rig
from rig.errors import BadInputError, RuleError, first_problem
from rig.settings import Settings
from rig_shared.user_files import MOST_TOML_BYTES, read_text, toml_of
from sim.config import FingertipConfig, Tissue
from sim.identification.prior import strain_of
from sim.identification.uncertainty_bands import standard_deviations
from sim.models.interpolation_weights import DERMIS, FAT

_log = logging.getLogger(__name__)

TISSUE = ("stiffness", "e_dermis", "e_fat", "stiffening")
"""Keys of `finger.tissue` in which likely fingers differ, besides relaxation."""

Relaxation = tuple[tuple[float, float], ...]
LONGEST_TAU_S = 60.0
"""Longest time constant (s), 40 times the slow one of fingertips (1.4 s, Pawluk & Howe 1999); 70 ms as s is more."""
_FEWEST_SUMMED = 2
_ASYMMETRY = 1e-6  # of a covariance, from rounding in the file


def checked_relaxation(series: Relaxation) -> Relaxation:
    """Validate a Prony series. Raises RuleError."""
    if any(not (share > 0 and tau_s > 0) for share, tau_s in series) or sum(share for share, _ in series) >= 1:
        raise RuleError(
            "not a Prony series: shares must be > 0 and sum to less than 1, time constants must be > 0 s",
            "no_prony_series",
        )
    for _, tau_s in series:
        if tau_s > LONGEST_TAU_S:
            raise RuleError(
                f"a time constant of {tau_s:g} s: must be at most {LONGEST_TAU_S:g} s; a fingertip's are 0.07 and "
                f"1.4 s (Pawluk & Howe 1999); if it is {tau_s:g} ms, write {tau_s / 1000:g}",
                "tau_too_long",
            )
    for what, of in (("sum", math.fsum), ("mean", fmean)):
        summary = [of(column) for column in zip(*series[:-1], strict=True)]
        if len(series) > _FEWEST_SUMMED and all(map(math.isclose, series[-1], summary)):
            raise RuleError(
                f"the last row, {list(series[-1])}, has the {what} of the others; delete it", "summary_row"
            )
    return series


class Place(Settings):
    """Position of the finger on the bench, and zero of the cell."""

    x_mm: float = Field(
        description="lateral position of the pad's center, from the one in the configuration of the bench, in mm"
    )
    x_sd_mm: float = Field(ge=0)
    height_mm: float = Field(description="height of the apex, from the one in the configuration of the bench, in mm")
    height_sd_mm: float = Field(ge=0)
    cell_zero_gwt: float
    cell_zero_sd_gwt: float = Field(ge=0)


class Posterior(Settings):
    """Result as a normal distribution, with bands; names that begin with ln_ are logarithms."""

    names: tuple[str, ...] = Field(min_length=1)
    mean: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]
    low: tuple[float, ...] | None = Field(
        None, description="lower ends of the bands; absent: those of the normal distribution"
    )
    high: tuple[float, ...] | None = Field(None, description="upper ends of the bands")

    @model_validator(mode="after")
    def _goes_together(self) -> Self:
        n, rows = len(self.names), self.covariance
        if len(self.mean) != n or len(rows) != n or any(len(row) != n for row in rows):
            raise RuleError(f"{n} names require {n} means and {n} rows of {n} covariances", "not_one_for_each_name")
        if any(len(ends) != n for ends in (self.low, self.high) if ends is not None):
            raise RuleError(f"{n} names require {n} ends of bands", "not_one_for_each_name")
        for name, low, high in zip(self.names, self.low or (), self.high or (), strict=False):
            if low > high:
                raise RuleError(f"band of {name}: low = {low:g} must be at most high = {high:g}", "low_above_high")
        for k, row in enumerate(rows):
            if row[k] < 0:
                raise RuleError(
                    f"covariance of {self.names[k]}: the variance {row[k]:g} must be at least 0", "negative_variance"
                )
            for j in range(k):
                if abs(row[j] - rows[j][k]) > _ASYMMETRY * math.sqrt(row[k] * rows[j][j]):
                    raise RuleError(
                        f"covariance of {self.names[k]} and {self.names[j]}: the matrix must be symmetric",
                        "not_symmetric",
                    )
        return self

    def band(self, name: str, coverage: float) -> tuple[float, float]:
        """Return the band of a parameter, as stored or of the normal distribution."""
        k = self.names.index(name)
        if self.low is not None and self.high is not None:
            return self.low[k], self.high[k]
        half = standard_deviations(coverage) * math.sqrt(self.covariance[k][k])
        return self.mean[k] - half, self.mean[k] + half


class Draw(Settings):
    """One of several equally likely fingers."""

    stiffness: float = Field(gt=0)
    e_dermis: float = Field(gt=0)
    e_fat: float = Field(gt=0)
    stiffening: float = Field(0.0, ge=0, description="0: a linear finger at small strain")
    relaxation: Relaxation = ()

    _lasts = field_validator("relaxation")(checked_relaxation)

    @property
    def tissue(self) -> dict[str, float | str]:
        """Keys of `finger.tissue` that this finger sets."""
        return {**self.model_dump(exclude={"relaxation"}), "strain": strain_of(self.stiffening)}

    @model_validator(mode="after")
    def _interpolated(self) -> Self:
        if not (DERMIS.low <= self.e_dermis <= DERMIS.high and FAT.low <= self.e_fat <= FAT.high):
            raise RuleError(
                f"e_dermis = {self.e_dermis:g}, e_fat = {self.e_fat:g} is outside the range of the model: "
                f"e_dermis {DERMIS.low:g} … {DERMIS.high:g}, e_fat {FAT.low:g} … {FAT.high:g}",
                "beyond_interpolation",
            )
        return self


class Band(Settings):
    """Width of predictions."""

    model_error: float = Field(
        ge=0, lt=1, description="relative standard deviation of the simulator's own force error"
    )
    coverage: float = Field(0.9, gt=0, lt=1)


class IdentifiedFinger(Settings):
    """Sources and uncertainty of an identified finger."""

    date: str
    version: str
    bench: str
    runs: tuple[str, ...] = Field(min_length=1)
    journals_sha256: tuple[str, ...] = Field(min_length=1)
    presses: int = Field(ge=1)
    collapsed: bool = Field(
        False,
        description="whether the identification collapsed onto too few fingers, which makes its bands meaningless",
    )
    flagged: str | None = Field(
        None, description="why no finger of the prior explains the presses; absent if one does"
    )
    not_learned: tuple[str, ...] = ()
    place: Place
    posterior: Posterior
    draw: tuple[Draw, ...] = Field(min_length=4)
    band: Band
    sha256: str | None = Field(
        None, description="of [finger] and the rest of [identified], to detect changes; absent in files of 0.2"
    )

    @model_validator(mode="after")
    def _one_hash_a_run(self) -> Self:
        if len(self.runs) != len(self.journals_sha256):
            runs = len(self.runs)
            raise RuleError(
                f"{runs} runs require {runs} hashes, got {len(self.journals_sha256)}", "not_one_hash_a_run"
            )
        return self


class FingerFile(Settings):
    """Content of a finger file."""

    finger: FingertipConfig
    relaxation: Relaxation
    identified: IdentifiedFinger

    _lasts = field_validator("relaxation")(checked_relaxation)

    def sealed(self) -> Self:
        """Return the file with the checksum of its finger and its identification."""
        sha256 = _checksum(self.finger, self.identified)
        return self.model_copy(update={"identified": self.identified.model_copy(update={"sha256": sha256})})

    def as_toml(self) -> str:
        """Return the file as TOML."""
        tables = self.model_dump(mode="json", exclude_none=True)
        return tomlkit.dumps(
            {"finger": tables["finger"], "virtual": {"relaxation": tables["relaxation"]}}
            | {"identified": tables["identified"]}
        )


def _checksum(finger: FingertipConfig, identified: IdentifiedFinger) -> str:
    """Return the checksum of an identification, without keys at their defaults, so that new keys do not change it."""
    content = {
        "finger": finger.model_dump(mode="json", exclude_defaults=True),
        "identified": identified.model_dump(mode="json", exclude_defaults=True, exclude={"sha256"}),
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def refuse_unusable(what: str, finger: FingertipConfig, identified: IdentifiedFinger) -> None:
    """Raise BadInputError for an identification that was changed after it was written, or that collapsed."""
    if identified.sha256 is None and identified.version.startswith("0.2."):
        _warn_of_missing_checksum(what)
    elif identified.sha256 != _checksum(finger, identified):
        raise BadInputError(
            f"{what}: [finger] or [identified] was changed after `rig identify` wrote it, so they may not "
            "describe one finger; repeat `rig identify`, or delete [identified] and give the file as --config",
            "changed_identification",
        )
    refuse_collapsed(what, identified)


@cache  # a command reads a file several times
def _warn_of_missing_checksum(what: str) -> None:
    _log.warning(
        "%s: [identified] is of version 0.2, which wrote no checksum, so changes made since cannot be detected", what
    )


def refuse_collapsed(what: str, identified: IdentifiedFinger) -> None:
    """Raise BadInputError for a collapsed identification."""
    if identified.collapsed or all(draw == identified.draw[0] for draw in identified.draw):
        raise BadInputError(
            f"{what}: the identification collapsed onto too few fingers, so its bands are meaningless; repeat "
            "`rig identify` until it ends with exit code 0",
            "collapsed",
        )


def refuse_flagged(what: str, identified: IdentifiedFinger, remedy: str = "") -> None:
    """Raise BadInputError for an identification that no finger of the prior explains; remedy: begins with a comma."""
    if identified.flagged is not None:
        raise BadInputError(
            f"{what}: no finger of the prior explains its presses: {identified.flagged}; repeat `rig "
            f"identify`{remedy}",
            "flagged",
        )


def fingers_of(finger: FingertipConfig, identified: IdentifiedFinger) -> list[FingertipConfig]:
    """Return the equally likely fingers, which differ only in the stiffness of their tissue."""
    return [finger.model_copy(update={"tissue": _tissue(finger.tissue, draw)}) for draw in identified.draw]


def _tissue(tissue: Tissue, draw: Draw) -> Tissue:
    """Return the tissue of a draw. Raises ValidationError."""
    return Tissue.model_validate(tissue.model_dump() | draw.tissue)


def read_finger_file(path: Path) -> FingerFile:
    """Read a finger file. Raises BadInputError."""
    what = f"finger file {path}"
    return finger_file_of(what, tables_in(what, path), path.parent)


def tables_in(what: str, path: Path) -> dict[str, Any]:
    """Read the tables of a TOML file. Raises BadInputError whose message begins with `what`."""
    try:
        return toml_of(read_text(path, encoding="utf-8-sig", most=MOST_TOML_BYTES))
    except OSError as error:
        problem = str(error.strerror or error)
        raise BadInputError(f"{what}: {problem}", "unreadable") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BadInputError(f"{what}: not valid TOML: {error}", "no_toml") from None


def example_finger() -> dict[str, Any]:
    """Return the table [finger] of the human-sized example, with the rows of its sections."""
    package = Path(rig.__file__).parent
    installed = package / "shipped_fingers" / "human_finger"
    folder = installed if installed.is_dir() else package.parent / "examples" / "human_finger"
    table = tables_in("the human-sized example", folder / "finger.toml")["finger"]
    found = FingertipConfig.model_validate(table, context={"folder": folder})
    return found.model_dump(exclude_unset=True)


def is_finger_file(tables: dict[str, Any]) -> bool:
    """Return whether the tables include the result of an identification."""
    return "identified" in tables


def finger_file_of(what: str, tables: dict[str, Any], folder: Path) -> FingerFile:
    """Validate the tables of a finger file. Raises BadInputError whose message begins with `what`."""
    if not is_finger_file(tables):
        raise BadInputError(
            f"{what}: no [identified] table; give a file that `rig identify` wrote", "no_identified_table"
        )
    virtual = tables.get("virtual", {})
    if not isinstance(virtual, dict):
        raise BadInputError(f"{what}: virtual: must be a table", "invalid_table")
    relaxation = virtual.get("relaxation", ())
    rest = {name: table for name, table in tables.items() if name != "virtual"}
    try:
        found = FingerFile.model_validate({**rest, "relaxation": relaxation}, context={"folder": folder})
        fingers_of(found.finger, found.identified)
    except ValidationError as error:
        raise first_problem(what, error, FingerFile) from None
    refuse_unusable(what, found.finger, found.identified)
    return found
