"""What made a run: versions, command, parameters, devices."""

import platform
import sys
from datetime import datetime
from importlib.metadata import version
from typing import Any

from rig.plan.config import Config
from rig.protocol.script import Script
from sim.models.fingertip import Fingertip

_PACKAGES = ("indentation-rig", "numpy", "scipy", "h5py", "pydantic", "matplotlib")


def provenance(
    script: Script, config: Config, finger: Fingertip, now: datetime, *, virtual: bool, subject: str | None = None
) -> dict[str, Any]:
    """All that `rig resume` and a reader in ten years need to know, ready for JSON."""
    prefix = "virtual " if virtual else ""
    return {
        "started_utc": now.isoformat(timespec="seconds"),
        "command": ["rig", *sys.argv[1:]],
        "protocol": script.path.name,
        "parameters": script.parameters.model_dump(mode="json"),
        "subject": subject,
        "virtual": virtual,
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "versions": {name: version(name) for name in _PACKAGES},
        "model": {
            "nodes": finger.model.nodes,
            "e_epidermis_mpa": finger.e_epidermis_mpa,
            "from_cache": finger.from_cache,
        },
        "devices": {"stage": f"{prefix}{config.stage.kind}", "force": f"{prefix}{config.force.kind}"},
    }
