"""How often the place of a receptor lies in its interval: synthetic recordings of receptors that are at no node.

    .venv/bin/python -m studies.accuracy.place_coverage [DRAWS]    # default 160; a quarter of them with an offset

Prints the table of docs/validation/comparison.md. Recordings are made on the finger that is fitted, by receptors at
places that are drawn at random; steps 1, 3, 5 at 2.33 gwt, or both bars at DOI 1.0, simulated without the bench.
"""

import sys
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compare.comparison import compare
from rig.compare.likelihood import Form
from rig.compare.place_grid import PlaceRange, PlaceRow, finger_with_grid
from rig.compare.receptor_place import receptor_location
from rig.compare.recordings.recording import Recording
from rig.compare.recordings.spikes import afferent_for, record
from rig.compare.stimuli import StimulusRow
from sim.config import FingertipConfig
from sim.models.fingertip import Fingertip
from studies.source.simulated_stimuli import stimulus

Array = NDArray[np.float64]

X_MM, DEPTH_MM, OFFSET_MM = (-2.0, 2.0), (0.5, 1.1), (-0.4, 0.4)
PRESSED_MM = np.arange(-4.42, 4.43, 0.17)
POSITIONS_MM = np.arange(-2.0, 2.01, 0.2)
SEED = 11
DRAWN = np.random.default_rng(SEED)
TRUE_X_MM = np.sort(DRAWN.uniform(-1.6, 1.6, 6)).round(3)
TRUE_DEPTH_MM = np.sort(DRAWN.uniform(0.55, 1.05, 4)).round(3)
MEASURED = ("ep1", "sed", "e13", "ep3")
NOISES = {"60 /s, 1 s, 5 repeats": (60.0, 1.0, 5), "20 /s, 0.5 s, 2 repeats": (20.0, 0.5, 2)}
SHAPES = {"steps": tuple((f"step:{n}", "force_gwt", 2.33) for n in "135"),
          "bars": tuple((f"bar:{width}", "doi_mm", 1.0) for width in ("1.5", "3.0"))}  # fmt: skip


class PlaceTruth(NamedTuple):
    """What was recorded: a measure at a place, with the field's centre off the receptor; mm."""

    measure: str
    x_mm: float
    depth_mm: float
    offset_mm: float


def pressed(finger: Fingertip, family: str) -> list[StimulusRow]:
    """A family's stimuli on a finger."""
    return [stimulus(finger, shape, PRESSED_MM, kind, value) for shape, kind, value in SHAPES[family]]


def drawn(
    made: list[StimulusRow], noise: tuple[float, float, int], with_offset: bool, rng: np.random.Generator
) -> tuple[PlaceTruth, list[Recording]]:
    """A truth, and its recordings."""
    peak, window_s, repeats = noise
    measure, receptor = str(rng.choice(MEASURED)), int(rng.integers(len(TRUE_X_MM) * len(TRUE_DEPTH_MM)))
    afferent = afferent_for(made, measure, receptor, peak, 0.4)
    offset = float(rng.uniform(-0.3, 0.3)) if with_offset else 0.0
    depth, x = np.divmod(receptor, len(TRUE_X_MM))
    truth = PlaceTruth(measure, float(TRUE_X_MM[x]), float(TRUE_DEPTH_MM[depth]), offset)
    return truth, [_moved(record(afferent, s, POSITIONS_MM + offset, rng, repeats, window_s), offset) for s in made]


def _moved(found: Recording, offset: float) -> Recording:
    """As recorded by someone who takes the field's centre to be elsewhere."""
    return Recording(**{**vars(found), "position_mm": found.position_mm - offset})


def held(row: PlaceRow, truth: PlaceTruth) -> list[float]:
    """Whether x, depth and offset lie in their intervals, and how wide these are."""
    pairs = (
        (row.x_interval, truth.x_mm),
        (row.depth_interval, truth.depth_mm),
        (row.offset_interval, truth.offset_mm),
    )
    return [float(low - 1e-9 <= value <= high + 1e-9) for (low, high), value in pairs] + [
        high - low for (low, high), _ in pairs
    ]


HEADER = ("stimuli", "noise", "offset", "draws", "x (%)", "depth (%)", "offset (%)", "width of x (mm)",
          "of depth (mm)", "of offset (mm)", "held by a bound (%)", "own fit not rejected (%)")  # fmt: skip


def row(
    family: str, noise: str, with_offset: bool, draws: int, fitted: list[StimulusRow], made: list[StimulusRow]
) -> str:
    """A line of the table."""
    rng = np.random.default_rng(SEED)
    where = PlaceRange(X_MM, DEPTH_MM, OFFSET_MM if with_offset else (0.0, 0.0))
    rows = []
    for _ in range(draws):
        truth, recordings = drawn(made, NOISES[noise], with_offset, rng)
        overlays = compare(fitted, {s.shape: one for s, one in zip(fitted, recordings, strict=True)}).overlays
        found = receptor_location(overlays, where, Form(), (truth.measure,))
        assert found is not None
        (one,) = found.rows
        rows.append([*held(one, truth), float(bool(one.at_bounds)), float(one.fits)])
    mean, middle = np.mean(rows, axis=0), np.median(rows, axis=0)
    shares = [f"{100 * value:.0f}" for value in mean[:3]]
    widths = [f"{value:.2f}" for value in middle[3:6]]
    if not with_offset:
        shares[2] = widths[2] = "–"
    cells = (family, noise, "fitted" if with_offset else "none", f"{draws}", *shares, *widths)
    return f"| {' | '.join((*cells, *(f'{100 * value:.0f}' for value in mean[6:])))} |"


def main() -> None:
    """Print the table."""
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else 160
    config = FingertipConfig()
    fitted = finger_with_grid(config, PlaceRange(X_MM, DEPTH_MM))
    recorded = Fingertip.load(config, receptor_x_mm=TRUE_X_MM.tolist(), receptor_depth_mm=TRUE_DEPTH_MM.tolist())
    print(f"nominal 95 %\n\n| {' | '.join(HEADER)} |\n|{'---|' * len(HEADER)}", flush=True)
    for family in SHAPES:
        on_grid, at_truths = pressed(fitted, family), pressed(recorded, family)
        for noise in NOISES:
            for with_offset in (False, True):
                print(
                    row(family, noise, with_offset, draws // 4 if with_offset else draws, on_grid, at_truths),
                    flush=True,
                )


if __name__ == "__main__":
    main()
