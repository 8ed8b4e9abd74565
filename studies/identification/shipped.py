"""Makes the tables of the default finger that come with the program (32 full builds, some minutes).

.venv/bin/python -m studies.identification.shipped
"""

import gzip
from functools import partial
from importlib.resources import files
from pathlib import Path

from rig.cli.identify_finger import USUAL_GOALS, scope_of
from rig.identify.adaptive_presses import SHAPES, IdentificationOptions
from sim.config import FingertipConfig
from sim.identification.force_table import FILE, ShapeTable, as_json
from sim.identification.predicted_forces import PredictedForces, finger_of, made_of
from sim.identification.prior import Prior


def main() -> None:
    """From the cache, or pressed; the file is written anew."""
    config, wanted = FingertipConfig(), IdentificationOptions(USUAL_GOALS, shapes=SHAPES)
    scope = PredictedForces.over(config, Prior(), *scope_of(wanted)).scope
    tables = []
    for name in wanted.indentors:
        tables.append(ShapeTable.read_or_make(name, scope, partial(finger_of, config), made_of(config)))
        print(f"{name}: off direct presses by {100 * tables[-1].error:.1f} % (rms)", flush=True)
    path = Path(str(files("sim"))) / "data" / FILE
    path.write_bytes(gzip.compress(as_json(tables).encode(), mtime=0))


if __name__ == "__main__":
    main()
