"""What a press costs where tissue stiffens, beside the linear twin's: processor time, on the default finger.

    OMP_NUM_THREADS=1 .venv/bin/python -m studies.stiffening.cost     # a minute; docs/validation/stiffening.md

Each from rest, the two in turn; the least of many, since what else a machine does only adds.
"""

import time
from collections.abc import Callable
from functools import partial

from sim.config import FingertipConfig
from sim.models.fingertip import Fingertip

SHAPES = ("bar:3.0", "cylinder:9", "sphere:4", "flat:3")
STIFFENING = 0.3
_DOI_MM, _FORCE_GWT = 0.6, 5.0
_TURNS = 12


def least_ms(presses: tuple[Callable[[], object], ...], turns: int = _TURNS) -> list[float]:
    """Of each press, interleaved."""
    taken: list[list[float]] = [[] for _ in presses]
    for _ in range(turns):
        for kept, press in zip(taken, presses, strict=True):
            began = time.process_time()
            press()
            kept.append(1e3 * (time.process_time() - began))
    return [min(one) for one in taken]


def main() -> None:
    """Print the table."""
    linear = Fingertip.load()
    tissue = linear.config.tissue.model_copy(update={"stiffening": STIFFENING})
    stiff = Fingertip.load(FingertipConfig(tissue=tissue))
    print("| shape | to 0.6 mm: linear, stiffening | to 5 gwt: linear, stiffening |", "|---|---|---|", sep="\n")
    for shape in SHAPES:
        to_depth = least_ms(tuple(partial(finger.indent, shape, doi_mm=_DOI_MM) for finger in (linear, stiff)))
        to_force = least_ms(tuple(partial(finger.indent, shape, force_gwt=_FORCE_GWT) for finger in (linear, stiff)))
        cells = [f"{first:.1f}, {second:.1f} ms ({second / first:.2f})" for first, second in (to_depth, to_force)]
        print(f"| {shape} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
