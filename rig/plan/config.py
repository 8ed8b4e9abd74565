"""The whole configuration: the rig's own settings, the finger model and the virtual bench."""

from pathlib import Path
from typing import Annotated, Self

import tomlkit
from pydantic import AfterValidator, Field, ValidationError, model_validator

from rig.devices.own_table import as_asked
from rig.engine.rig_settings import RigSettings
from rig.errors import RuleError, around
from rig.plan.met.finger_file import Met, checked_relaxation, read_finger_file, refuse_collapsed, tables_in
from rig.protocol.errors import WRITTEN_BY_COMMANDS, first_problem
from rig.transport.port_settings import Settings
from sim.config import FingertipConfig


def _named(indentor: str) -> str:
    if not indentor.strip():
        raise ValueError("expected an indentor, such as bar:3.0")
    return indentor


class VirtualSettings(Settings):
    """How the virtual bench differs from what the rig believes; by default in nothing."""

    x_screw_steps_per_mm: float | None = Field(
        None, gt=1, lt=1e6, description="of the true screw; absent: as the rig believes"
    )
    z_screw_steps_per_mm: float | None = Field(None, gt=1, lt=1e6, description="the same of the vertical axis")
    x_screw_backlash_mm: float = Field(0.0, ge=0, le=1, description="true lost motion; felt when going up")
    z_screw_backlash_mm: float = Field(0.0, ge=0, le=1, description="the same of the vertical axis")
    compliance_mm_per_n: float = Field(0.0, ge=0, le=1, description="how far the true rig gives under a force")
    finger_x_offset_mm: float = Field(0.0, ge=-5, le=5, description="true pad centre − frame.pad_centre_x_mm")
    finger_z_offset_mm: float = Field(0.0, ge=-2, le=2, description="true apex − frame.apex_z_mm")
    finger_along_offset_mm: float = Field(0.0, ge=-3, le=3, description="true receptor plane − frame.pad_y_mm")
    finger_roll_deg: float = Field(0.0, ge=-20, le=20, description="about the finger's axis; for spheres only")
    finger_tilt_deg: float = Field(0.0, ge=-20, le=20, description="about x; for spheres only")
    stiffness: float = Field(1.0, gt=0, le=100, description="true force over the predicted one")
    relaxation: tuple[tuple[float, float], ...] = Field(
        (), description="Prony series of the tissue: [share, time constant in s], shares sum to less than 1"
    )
    cell_noise_gwt: float = Field(0.0, ge=0, le=10, description="standard deviation of each sample")
    cell_drift_gwt_per_min: float = Field(0.0, ge=-5, le=5, description="how fast the zero of the cell goes away")
    cell_latency_s: float = Field(0.0, ge=0, le=1, description="how late a sample truly is")
    cell_resolution_gwt: float = Field(0.01, ge=0.001, le=10, description="one step of what the virtual sensor shows")
    noise_seed: int = Field(0, ge=0, description="the same seed gives the same noise")
    indentor: Annotated[str, AfterValidator(_named)] = Field("bar:3.0", description="on the carriage of `rig serve`")

    @model_validator(mode="after")
    def _relaxes(self) -> Self:
        try:
            checked_relaxation(self.relaxation)
        except ValueError as error:
            raise around(RuleError, "relaxation: {problem}", error) from None
        return self


class Config(RigSettings):
    """A configuration file; every table and key has a default."""

    finger: FingertipConfig = FingertipConfig()
    virtual: VirtualSettings = VirtualSettings()
    met: Met | None = Field(
        None, description="how well the finger is known: docs/meet.md", json_schema_extra=WRITTEN_BY_COMMANDS
    )

    def as_toml(self) -> str:
        """Every table and value, as a configuration file that gives this configuration."""
        return tomlkit.dumps(self.model_dump(mode="json", exclude_none=True))


def load_config(path: Path | None) -> Config:
    """The configuration in a TOML file, or the defaults. Raises BadInputError.

    Paths in it are relative to the file's folder.
    """
    if path is None:
        return Config()
    tables = tables_in(f"config {path}", path)
    try:
        found = Config.model_validate(tables, context={"folder": path.parent})
    except ValidationError as error:
        raise first_problem(f"config {path}", error, as_asked(Config, tables)) from None
    if found.met is not None:
        refuse_collapsed(f"config {path}", found.met)
    return found


def with_finger(config: Config, path: Path | None) -> Config:
    """The configuration with the finger of a file that `rig meet` wrote; None: as it is. Raises BadInputError.

    The virtual bench's finger relaxes as that one does, unless the configuration says how.
    """
    if path is None:
        return config
    found = read_finger_file(path)
    told = "relaxation" in config.virtual.model_fields_set
    relaxes = {} if told else {"relaxation": found.relaxation}
    virtual = config.virtual.model_copy(update=relaxes)
    return config.model_copy(update={"finger": found.finger, "met": found.met, "virtual": virtual})
