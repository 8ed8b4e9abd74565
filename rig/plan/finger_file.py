"""The file of a finger that the rig has met: a piece of a configuration, and what the rig learned and from what.

A configuration has its tables: `[finger]` the likeliest finger, `[virtual]` how its tissue relaxes, `[met]` the rest.
"""

import math
import tomllib
from pathlib import Path
from typing import Any, Self

import tomlkit
from pydantic import Field, ValidationError, field_validator, model_validator

from rig.errors import BadInputError, RuleError, first_problem
from rig.settings import Settings
from sim.config import FingertipConfig, Tissue
from sim.models.weights import DERMIS, FAT

TISSUE = ("stiffness", "e_dermis", "e_fat", "stiffening")
"""What likely fingers differ in, besides how they relax: keys of `finger.tissue`."""

Relaxation = tuple[tuple[float, float], ...]
_ASYMMETRY = 1e-6  # of a covariance that was written with fewer digits


def checked_relaxation(series: Relaxation) -> Relaxation:
    """A Prony series of which something lasts. Raises RuleError."""
    if any(not (share > 0 and tau_s > 0) for share, tau_s in series) or sum(share for share, _ in series) >= 1:
        raise RuleError(
            "not a Prony series: shares must be > 0 and sum to less than 1, time constants must be > 0 s",
            code="no_prony_series",
        )
    return series


class Place(Settings):
    """Where the finger lay on the bench, and the cell's zero."""

    x_mm: float = Field(
        description="lateral position of the pad's center, from the one in the configuration of the bench, in mm"
    )
    x_sd_mm: float = Field(ge=0)
    height_mm: float = Field(description="height of the apex, from the one in the configuration of the bench, in mm")
    height_sd_mm: float = Field(ge=0)
    cell_zero_gwt: float
    cell_zero_sd_gwt: float = Field(ge=0)


class Posterior(Settings):
    """What was learned, as one normal distribution: a name that begins with ln_ is of a logarithm."""

    names: tuple[str, ...] = Field(min_length=1)
    mean: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]

    @model_validator(mode="after")
    def _goes_together(self) -> Self:
        n, rows = len(self.names), self.covariance
        if len(self.mean) != n or len(rows) != n or any(len(row) != n for row in rows):
            raise RuleError(
                "{names} names require {names} means and {names} rows of {names} covariances",
                code="not_one_for_each_name",
                names=n,
            )
        for k, row in enumerate(rows):
            if row[k] < 0:
                raise RuleError(
                    "covariance of {name}: the variance {variance:g} must be at least 0",
                    code="negative_variance",
                    name=self.names[k],
                    variance=row[k],
                )
            for j in range(k):
                if abs(row[j] - rows[j][k]) > _ASYMMETRY * math.sqrt(row[k] * rows[j][j]):
                    raise RuleError(
                        "covariance of {name} and {other}: the matrix must be symmetric",
                        code="not_symmetric",
                        name=self.names[k],
                        other=self.names[j],
                    )
        return self


class Draw(Settings):
    """One of the equally likely fingers."""

    stiffness: float = Field(gt=0)
    e_dermis: float = Field(gt=0)
    e_fat: float = Field(gt=0)
    stiffening: float = Field(0.0, ge=0)
    relaxation: Relaxation = ()

    _lasts = field_validator("relaxation")(checked_relaxation)

    @model_validator(mode="after")
    def _interpolated(self) -> Self:
        if not (DERMIS.low <= self.e_dermis <= DERMIS.high and FAT.low <= self.e_fat <= FAT.high):
            raise RuleError(
                "e_dermis = {e_dermis:g}, e_fat = {e_fat:g} is outside the range of the model: e_dermis "
                "{e_dermis_low:g} … {e_dermis_high:g}, e_fat {e_fat_low:g} … {e_fat_high:g}",
                code="beyond_interpolation",
                e_dermis=self.e_dermis,
                e_fat=self.e_fat,
                e_dermis_low=DERMIS.low,
                e_dermis_high=DERMIS.high,
                e_fat_low=FAT.low,
                e_fat_high=FAT.high,
            )
        return self


class Band(Settings):
    """How wide a prediction is made."""

    model_error: float = Field(
        ge=0, lt=1, description="relative standard deviation of the simulator's own force error"
    )
    coverage: float = Field(0.9, gt=0, lt=1)


class Met(Settings):
    """Where a met finger's numbers come from, and how well they are known."""

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
    not_learned: tuple[str, ...] = ()
    place: Place
    posterior: Posterior
    draw: tuple[Draw, ...] = Field(min_length=4)
    band: Band

    @model_validator(mode="after")
    def _one_hash_a_run(self) -> Self:
        if len(self.runs) != len(self.journals_sha256):
            raise RuleError(
                "{runs} runs require {runs} hashes, got {hashes}",
                code="not_one_hash_a_run",
                runs=len(self.runs),
                hashes=len(self.journals_sha256),
            )
        return self


class FingerFile(Settings):
    """A whole file."""

    finger: FingertipConfig
    relaxation: Relaxation
    met: Met

    _lasts = field_validator("relaxation")(checked_relaxation)

    def as_toml(self) -> str:
        """As it is written."""
        tables = self.model_dump(mode="json", exclude_none=True)
        return tomlkit.dumps(
            {"finger": tables["finger"], "virtual": {"relaxation": tables["relaxation"]}} | {"met": tables["met"]}
        )


def refuse_collapsed(what: str, met: Met) -> None:
    """Raise BadInputError for an identification that collapsed; files of version 0.1 show it by equal draws only."""
    if met.collapsed or all(draw == met.draw[0] for draw in met.draw):
        raise BadInputError(
            "{where}: the identification collapsed onto too few fingers, so its bands are meaningless; "
            "repeat `rig meet` until it ends with exit code 0",
            code="collapsed",
            where=what,
        )


def fingers_of(finger: FingertipConfig, met: Met) -> list[FingertipConfig]:
    """The equally likely ones, alike in all but the tissue's stiffness."""
    return [finger.model_copy(update={"tissue": _tissue(finger.tissue, draw)}) for draw in met.draw]


def _tissue(tissue: Tissue, draw: Draw) -> Tissue:
    """Raises ValidationError where a draw is no tissue."""
    return Tissue.model_validate(tissue.model_dump() | draw.model_dump(exclude={"relaxation"}))


def read_finger_file(path: Path) -> FingerFile:
    """What is in a file. Raises BadInputError: one line on what is wrong where."""
    what = f"finger file {path}"
    return finger_file_of(what, tables_in(what, path), path.parent)


def tables_in(what: str, path: Path) -> dict[str, Any]:
    """The tables of a TOML file. Raises BadInputError, which begins with what it is."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        problem = str(error.strerror or error)
        raise BadInputError("{where}: {problem}", code="unreadable", where=what, problem=problem) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BadInputError("{where}: not valid TOML: {problem}", code="no_toml", where=what,
                            problem=str(error)) from None  # fmt: skip


def finger_file_of(what: str, tables: dict[str, Any], folder: Path) -> FingerFile:
    """What is in tables. Raises BadInputError, which begins with what they are of."""
    if "met" not in tables:
        raise BadInputError(
            "{where}: no [met] table; give a file that `rig meet` wrote", code="no_met_table", where=what
        )
    relaxation = tables.get("virtual", {}).get("relaxation", ())
    rest = {name: table for name, table in tables.items() if name != "virtual"}
    try:
        found = FingerFile.model_validate({**rest, "relaxation": relaxation}, context={"folder": folder})
        fingers_of(found.finger, found.met)
    except ValidationError as error:
        raise first_problem(what, error) from None
    refuse_collapsed(what, found.met)
    return found
