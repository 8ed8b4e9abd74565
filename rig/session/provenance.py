"""What made a run: versions, command, parameters, devices."""

import platform
import subprocess
import sys
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rig.plan.config import Config
from rig.plan.finger_model import about_model
from rig.protocol.script import Script
from sim.finger_process import Finger, asked

_PATIENCE_S = 5.0
_PACKAGES = ("indentation-rig", "numpy", "scipy", "h5py", "pydantic", "matplotlib")


def provenance(
    script: Script, config: Config, finger: Finger | None, now: datetime, *, virtual: bool, subject: str | None = None
) -> dict[str, Any]:
    """All that `rig resume` and a reader in ten years need to know, as JSON; no finger: it was not loaded yet."""
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
        "commit": commit(Path(__file__)),
        "model": None if finger is None else asked(finger, about_model),
        "devices": {"stage": f"{prefix}{config.stage.kind}", "force": f"{prefix}{config.force.kind}"},
    }


def commit(file: Path) -> str | None:
    """The commit that a file of this program is at, marked where its tree has changes; None outside a work tree."""
    described = _git(file.parent, "ls-files", "--error-unmatch", file.name)
    head = _git(file.parent, "rev-parse", "HEAD") if described else ""
    if not head:
        return None
    return f"{head} with changes" if _git(file.parent, "status", "--porcelain", "--untracked-files=no") else head


def _git(folder: Path, *words: str) -> str:
    """What git says, nothing where it fails or is not there."""
    try:
        done = subprocess.run(["git", *words], cwd=folder, capture_output=True, text=True, timeout=_PATIENCE_S)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""
