"""What `rig check` says, against the dry-run that follows: the tables of docs/validation/check.md.

.venv/bin/python -m studies.accuracy.check_predictions                 # on the finger that was expected
.venv/bin/python -m studies.accuracy.check_predictions --unexpected    # on one 30 % stiffer that relaxes
"""

import argparse
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.script import load_script
from rig.session.rehearsal_summary import preflight
from rig.session.session import NewRun, Session, dry_run
from sim.models.fingertip import Fingertip

PROTOCOLS = (
    ("first_press",),
    ("steps", "step=1"),
    ("steps", "step=3"),
    ("steps", "step=5"),
    ("steps", "step=1", "force_gwt=8"),
    ("bars", "width_mm=1.5"),
    ("bars", "width_mm=3.0"),
    ("cylinders", "diameter_mm=3"),
    ("cylinders", "diameter_mm=9"),
    ("gratings",),
    ("paired_forces",),
)
# A share of 0.3 relaxes within a second, as long as a hold lasts.
UNEXPECTED: dict[str, Any] = {"virtual": {"stiffness": 1.3, "relaxation": [[0.3, 1.0]]}}


@dataclass(frozen=True)
class Compared:
    """What was said and what was, duration in s and highest reading in gwt."""

    name: str
    said_s: float
    was_s: float
    said_gwt: float
    was_gwt: float
    ended: str

    def row(self) -> str:
        """One line of the table."""
        return (
            f"| `{self.name}` | {self.said_s:.1f}, {self.was_s:.1f} | {_off(self.said_s, self.was_s)} "
            f"| {self.said_gwt:.3f}, {self.was_gwt:.3f} | {_off(self.said_gwt, self.was_gwt)} | {self.ended} |"
        )


def compared(words: tuple[str, ...], config: Config, finger: Fingertip, out: Path) -> Compared:
    """Check a shipped protocol, then rehearse it on the finger."""
    script = load_script(words[0], words[1:])
    plan = make_plan(script, config, finger)
    said = preflight(script, config, finger, plan).as_json()
    done = dry_run(Session(script, config, finger, plan, NewRun(out)))
    was_gwt = max(sample["force_gwt"] for sample in done.run.stream("sample"))
    ended = "done" if done.problem is None else str(done.problem)
    return Compared(" ".join(words), said["duration_s"], done.duration_s, said["peak_force_gwt"], was_gwt, ended)


def _off(said: float, was: float) -> str:
    return f"{100 * (said / was - 1):+.1f} %"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--unexpected", action="store_true", help="a finger 30 % stiffer that relaxes")
    config = Config.model_validate(UNEXPECTED if parser.parse_args().unexpected else {})
    finger = Fingertip.load(config.finger)
    print("| protocol | duration said, was (s) | off by | peak force said, was (gwt) | off by | ended |")
    print("|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for words in PROTOCOLS:
            print(compared(words, config, finger, Path(folder)).row(), flush=True)


if __name__ == "__main__":
    main()
