"""The whole configuration: the rig's own settings, the finger model and the virtual bench."""

import json
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError

from rig.protocol.errors import BadInputError, first_problem
from rig.settings import RigSettings, Settings
from sim.config import FingertipConfig


class VirtualSettings(Settings):
    """How the virtual bench differs from what the rig believes; all zero differences by default."""

    x_screw_steps_per_mm: float = Field(400.0, gt=1, lt=1e6)
    z_screw_steps_per_mm: float = Field(400.0, gt=1, lt=1e6)
    finger_x_offset_mm: float = Field(0.0, ge=-5, le=5, description="true pad centre − frame.pad_centre_x_mm")
    finger_z_offset_mm: float = Field(0.0, ge=-2, le=2, description="true apex − frame.apex_z_mm")


class Config(RigSettings):
    """A configuration file; every table and key has a default."""

    finger: FingertipConfig = FingertipConfig()
    virtual: VirtualSettings = VirtualSettings()

    def as_toml(self) -> str:
        """Every table and value, as a configuration file that gives this configuration."""
        return "\n".join(_toml_tables(self.model_dump(mode="json", exclude_none=True))) + "\n"


def _toml_tables(values: dict[str, Any], prefix: str = "") -> Iterator[str]:
    for key, value in values.items():
        if not isinstance(value, dict):
            yield f"{key} = {json.dumps(value, ensure_ascii=False)}".replace("\x7f", "\\u007f")
    for key, value in values.items():
        if isinstance(value, dict):
            yield f"\n[{prefix}{key}]"
            yield from _toml_tables(value, f"{prefix}{key}.")


def load_config(path: Path | None) -> Config:
    """The configuration in a TOML file, or the defaults. Raises BadInputError."""
    if path is None:
        return Config()
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInputError(f"config {path}: {error.strerror or error}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BadInputError(f"config {path}: not valid TOML: {error}") from None
    try:
        return Config.model_validate(tables)
    except ValidationError as error:
        raise first_problem(f"config {path}", error) from None
