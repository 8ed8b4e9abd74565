"""The loop with a known truth: protocol, dry run, spikes, file, comparison, and the verdict beside the truth.

.venv/bin/python -m studies run nerve-loop

One dry run has all repeats; the first of them are a shorter run. The verdict is that of `rig compare` with the place
of the afferent as --field-centre-mm, at the ten default receptors.
"""

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from rig.compare.comparison import compare
from rig.compare.exceptions import RecordingError
from rig.compare.likelihood import Form
from rig.compare.make_verdict import answers
from rig.compare.recordings.recording import Recording, recording
from rig.compare.recordings.spike_times import SpikeTimes
from rig.compare.recordings.spikes import rates_in_run, read_spike_times
from rig.compare.stimuli import StimulusRow, stimuli
from rig.compare.verdict import AfferentVerdict
from rig.data import Run
from rig.data.export import export_nwb
from rig.data.spike_files import SpikeRecord
from rig.plan.config import Config
from rig.plan.nerve import run_spikes, visits_of
from rig.plan.plan import make_plan
from rig.protocol.script import load_script
from rig.session.session import NewRun, Session, dry_run
from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from sim.nerve.population import Afferent, AfferentPopulation, draw
from studies.registry import show

Array = NDArray[np.float64]

BAR, DOI_MM, HOLD_S = "bar:3.0", 0.8, 1.0
PLACES_MM = tuple(np.round(np.arange(-2.4, 2.41, 0.4), 2).tolist())
REPEATS = (1, 3, 10)
SEEDS = {"SA1": (1, 2, 3, 4), "RA": (1, 2), "PC": (1, 2)}
"""Seeds of the afferents of each class; RA and PC hardly fire in a hold."""
TESTED_MM = (-1.0, -0.5, 0.0, 0.5, 1.0)
"""Places of afferents at receptors that the comparison tests."""
DRAWN = 5
"""Number of afferents of a class and seed at places drawn over the pad."""
FARTHEST_MM = 1.5
"""Distance from the middle within which drawn afferents are used: others see too few presses."""
STEP_S = 1e-3
TRUTH = {"SA1": "sed", "RA": "sed", "PC": "sed"}
"""The measure at the receptor that drives each class: itself, or the rate or acceleration of its square root."""

HEADER = (
    "class", "receptor", "repeats", "minutes", "afferents", "hardly fired", "SED in the set (%)",
    "no measure left (%)", "a control in the set (%)", "measures in the set",
)  # fmt: skip
_LEVEL = 0.95

PROTOCOL = """\
from rig.protocol import Rig

def run(rig: Rig) -> None:
    rig.mount({bar!r})
    rig.home()
    rig.zero()
    for _ in range({repeats}):
        for x_mm in {places}:
            rig.move_to(x_mm=x_mm)
            rig.indent(doi_mm={doi_mm}, hold_s={hold_s})
"""


def rehearsed(finger: Fingertip, folder: Path, repeats: int = REPEATS[-1]) -> Run:
    """Return a dry run of the protocol."""
    path = folder / "loop.py"
    text = PROTOCOL.format(bar=BAR, repeats=repeats, places=PLACES_MM, doi_mm=DOI_MM, hold_s=HOLD_S)
    path.write_text(text, encoding="utf-8")
    script, config = load_script(str(path)), Config()
    plan = make_plan(script, config, finger)
    return dry_run(Session(script, config, finger, plan, NewRun(folder))).run


@dataclass(frozen=True)
class Truth:
    """An afferent and whether its receptor is one that the comparison tests."""

    afferent: Afferent
    tested: bool


def truths(finger: Fingertip) -> list[Truth]:
    """Return afferents of all classes at tested receptors, and as many over the pad."""
    found = []
    for name, seeds in SEEDS.items():
        for seed in seeds:
            at = draw(finger, ",".join(f"{name}@{x}" for x in TESTED_MM), seed)
            found += [Truth(one, tested=True) for one in at]
            over = draw(finger, f"{DRAWN if name == 'PC' else 4 * DRAWN}x{name}", 100 + seed)
            near = [one for one in over if abs(one.x_mm) <= FARTHEST_MM]
            found += [Truth(one, tested=False) for one in near[:DRAWN]]
    return found


def spikes(run: Run, finger: Fingertip, afferents: Sequence[Afferent]) -> SpikeRecord:
    """Return the spikes during a run, with presses at the commanded places only."""
    found = visits_of(run, Config())
    rounded = replace(found, visits=tuple(replace(one, x_mm=round(one.x_mm, 2)) for one in found.visits))
    return run_spikes(run, rounded, finger, AfferentPopulation(afferents), step_s=STEP_S)


def times(path: Path, run: Run, unit: int) -> SpikeTimes:
    """Return the spikes of a unit as `rig compare` reads them; none of one that never fired."""
    try:
        return read_spike_times(path, run, str(unit))
    except RecordingError as error:
        if error.code != "no_spikes":
            raise
        return SpikeTimes(np.empty(0))


def first_repeats(whole: Recording, repeats: int) -> Recording:
    """Return the recording of a run with fewer repeats."""
    rows = [
        (float(x), float(rate), np.nan)
        for x, rates in zip(whole.position_mm, whole.repeats, strict=True)
        for rate in rates[:repeats]
    ]
    return recording(whole.name, rows, whole.window_s)


def verdict(pressed: Sequence[StimulusRow], recorded: Recording, form: Form = Form()) -> AfferentVerdict:  # noqa: B008
    """Return the verdict of `rig compare` on one recording."""
    (found,) = answers(compare(list(pressed), {pressed[0].shape: recorded}), form)
    return found


def minutes(run: Run, repeats: int) -> float:
    """Return the duration of the run to the end of a repeat (min)."""
    ends = [event["t_s"] for event in run.stream("hold_end")]
    return float(ends[repeats * len(PLACES_MM) - 1] - run.start["t_s"]) / 60


@dataclass(frozen=True)
class Judged:
    """What a verdict says of a known truth."""

    outcome: str
    contains: bool
    measures: int

    @classmethod
    def of(cls, found: AfferentVerdict, truth: str) -> "Judged":
        """Return the judgment of a verdict."""
        names = {row.name for row in found.set}
        return cls(found.outcome, truth in names, len(names))


def interval(hits: int, of: int) -> tuple[float, float]:
    """Return Wilson's 95 % interval of a share."""
    if not of:
        return float("nan"), float("nan")
    z2 = float(ndtri(0.5 + _LEVEL / 2)) ** 2
    middle, half = (hits + z2 / 2) / (of + z2), np.sqrt(z2 * (hits * (of - hits) / of + z2 / 4)) / (of + z2)
    return float(middle - half), float(middle + half)


def share(flags: Sequence[bool]) -> str:
    """Return a share with its interval, in per cent."""
    if not flags:
        return "–"
    low, high = interval(sum(flags), len(flags))
    return f"{100 * sum(flags) / len(flags):.0f} ({100 * max(low, 0):.0f} to {100 * min(high, 1):.0f})"


def cells(found: Sequence[Judged]) -> tuple[str, ...]:
    """Return the numbers of a row: shares of the afferents that fired."""
    fired = [one for one in found if one.outcome != "silent"]
    size = f"{np.mean([one.measures for one in fired]):.1f}" if fired else "–"
    return (
        f"{len(found)}",
        f"{len(found) - len(fired)}",
        share([one.contains for one in fired]),
        share([one.outcome == "nothing" for one in fired]),
        share([one.outcome == "not beyond controls" for one in fired]),
        size,
    )


def rows(run: Run, finger: Fingertip, found: Sequence[Truth]) -> Iterator[tuple[str, ...]]:
    """Yield the table, class by class."""
    path = export_nwb(run, spikes(run, finger, [one.afferent for one in found]))
    pressed = stimuli(run, finger)
    for name, truth in TRUTH.items():
        for tested in (True, False):
            mine = [n for n, one in enumerate(found) if (one.afferent.model, one.tested) == (name, tested)]
            whole = [
                rates_in_run(run, BAR, times(path, run, n), path.name, (0.0, HOLD_S), found[n].afferent.x_mm)
                for n in mine
            ]
            for repeats in REPEATS:
                judged = [Judged.of(verdict(pressed, first_repeats(one, repeats)), truth) for one in whole]
                where = "tested" if tested else "over the pad"
                yield name, where, f"{repeats}", f"{minutes(run, repeats):.0f}", *cells(judged)


def main() -> None:
    """Print the table."""
    finger = load("finger")
    with tempfile.TemporaryDirectory() as folder:
        run = rehearsed(finger, Path(folder))
        show(HEADER, rows(run, finger, truths(finger)))


if __name__ == "__main__":
    main()
