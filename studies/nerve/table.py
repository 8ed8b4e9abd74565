"""The 18 published tests beside our classes of afferents, their parameters, and what vibration and time cost.

.venv/bin/python -m studies.nerve.table [TEST…]
"""

import re
import sys
import time
from collections.abc import Iterator
from dataclasses import fields

from sim.nerve.models import BUILT_IN, spikes_of
from sim.nerve.population import SENSITIVITY_SPREAD
from sim.nerve.skin import SkinUnderIndentor, table_of_presses
from studies.nerve.rows import TESTS, Row
from studies.nerve.scenes import PRELOAD_MM, PROBE, Scenes, ramp, sensitivities
from studies.registry import show

HEADER = ("test", "stimulus", "published", "ours: mean (range over seeds)", "TouchSim", "verdict", "remark")
PARAMETERS = ("class", "parameter", "value", "from")
LINEAR = ("indentor", "amplitude (µm)", "slope alone: error (%)", "table: error (%)", "nodes that change contact (%)")
STEPS = ("class", "impulses at 1 ms", "at 0.25 ms", "change (%)", "100 afferents for 1 s: CPU s")

SPREAD = "spread of sensitivity"

FITTED = {
    ("SA1", "weights"): "fitted on tests 1 and 6",
    ("SA1", "threshold"): "fitted on test 6",
    ("SA1", "slow_share"): "fitted on test 1",
    ("SA1", "slow_tau_s"): "chosen by order, test 15",
    ("RA", "slow_tau_s"): "chosen by order, test 15",
    ("PC", "slow_tau_s"): "chosen by order, test 15",
    ("RA", "slow_share"): "free, not fitted",
    ("PC", "slow_share"): "free, not fitted",
    ("SA1", "reference_sed"): "fitted on test 11",
    ("RA", "reference_sed"): "fitted on test 11",
    ("PC", "reference_sed"): "fitted on test 12",
    ("RA", "falling"): "fitted on tests 9, 11 and 16",
    ("RA", "most"): "Saal et al. (2017), median of nine",
    ("PC", "most"): "fitted on test 12",
    ("SA1", "membrane"): "τ Freeman and Johnson (1982); noise fitted on test 5",
    ("RA", "membrane"): "Saal et al. (2017), medians of nine",
    ("PC", "membrane"): "τ, refractory time Saal et al. (2017); noise fitted on test 12",
    ("SA1", "tau_s"): "Gerling et al. (2018)",
    ("SA1", "sites"): "Lesniak et al. (2014)",
    ("RA", "corner_hz"): "Saal et al. (2017), median of nine",
    ("PC", "corner_hz"): "Saal et al. (2017)",
    ("SA1", "organs"): "fitted on test 6, with which 5 in 2.5 mm do not agree",
    ("RA", "organs"): "zones in human fields, 12 to 17 (Johansson 1978, not checked)",
    ("SA1", "field_mm"): "one end organ",
    ("PC", "organs"): "anatomy",
    ("PC", "field_mm"): "one end organ",
    ("RA", "field_mm"): "3 to 5 mm of a monkey's skin (Johnson 2001, not checked)",
    ("SA1", SPREAD): "thresholds of Johansson and Vallbo (1979), 2 to 3",
    ("RA", SPREAD): "fitted on tests 9, 11 and 16, between 2 and 3",
    ("PC", SPREAD): "thresholds of Johansson and Vallbo (1979), 2 to 3",
}
"""Where each parameter comes from; the others are anatomy."""


CAUSES = {
    "2, SA1": "one end organ for an afferent that has 4 to 7 (Johansson 1978); "
    "strain at 1.6 mm is beyond small strain",
    "2, RA": "the array's own SED is large",
    "3, RA": "as test 2; nothing saturates",
    "4, SA1": "noise fitted on test 5, where intervals vary more",
    "7, RA": "monkeys' vibration sets the gain; the probe and the speed of the source are not stated",
    "7, PC": "the corners of our ramp, 10 ms, set its acceleration",
    "8, PC": "few impulses a ramp, so that single ones decide which curve fits",
    "10, RA": "driven by √SED, whose profile under the step is that of SA1's SED",
    "14, all": "thresholds of the classes at their preload",
    "15, all": "thresholds are read to 5 %, too coarse for slow changes",
    "16, RA": "the off-response begins before an octave",
    "17, all": "SA1 turns at 32 Hz (published: 5 Hz), as late as RA: its noise is large beside its drive",
}
"""Likely cause of each failure."""


_NEGATIVE = re.compile(r"(?<!\w)-(?=\d)")


def cells(row: Row) -> tuple[str, ...]:
    """Return a row of the table."""
    verdict = {True: "pass", False: "fail", None: "not counted"}[row.passed]
    cause = CAUSES.get(row.test, "") if row.passed is False else ""
    remark = "; ".join(filter(None, (row.remark, cause)))
    return tuple(
        _NEGATIVE.sub("−", text.replace("|", "\\|"))
        for text in (row.test, row.stimulus, row.published, row.ours, row.touchsim, verdict, remark)
    )


def parameters() -> Iterator[tuple[str, ...]]:
    """Yield every parameter of the classes, and where it comes from."""
    for name, model in BUILT_IN.items():
        for one in fields(model):  # type: ignore[arg-type]
            value = getattr(model, one.name)
            if one.name == "membrane":
                value = f"τ {value.tau_s:g} s, refractory {value.refractory_s:g} s, noise {value.noise:g}, " + (
                    f"reset {value.reset:g}" + (f", current after a spike {value.after:g}" if value.after else "")
                )
            elif one.name == "name":
                continue
            elif isinstance(value, tuple):
                value = ", ".join(f"{each:g}" for each in value)
            yield name, one.name, f"{value}", FITTED.get((name, one.name), "anatomy")
        yield name, SPREAD, f"{SENSITIVITY_SPREAD[name]:g}", FITTED[name, SPREAD]


def frozen_contact(scenes: Scenes) -> Iterator[tuple[str, ...]]:
    """Yield how far the response to a sine at the preload departs from the slope there, and from the table."""
    model, finger = BUILT_IN["RA"], scenes.finger
    points = finger.points_below([0.0], model.depth_mm)
    for indentor in (PROBE, "bar:3.0", "cylinder:9"):
        presses = table_of_presses(finger, indentor, 1.0)
        skin = SkinUnderIndentor(finger, indentor, points, model.measure, 1.0, presses=presses)
        slope = float(skin.value.derivative()(PRELOAD_MM)[0])
        here = finger.indent(indentor, doi_mm=PRELOAD_MM)
        centre = float(model.measure(finger.fields(here, points).measures)[0])
        for amplitude_um in (10, 25, 50, 100, 250):
            line, table, changed = [], [], 0
            for sign in (-1, 1):
                depth = PRELOAD_MM + sign * 1e-3 * amplitude_um
                there = finger.indent(indentor, doi_mm=depth)
                moved = float(model.measure(finger.fields(there, points).measures)[0]) - centre
                line.append(abs(slope * sign * 1e-3 * amplitude_um / moved - 1))
                table.append(abs(float(skin.value(depth)[0] - skin.value(PRELOAD_MM)[0]) / moved - 1))
                changed += int((there.state.active != here.state.active).sum())
            share = changed / 2 / int(here.state.active.sum())
            yield indentor, f"{amplitude_um}", *(f"{100 * value:.1f}" for value in (max(line), max(table), share))


def steps(scenes: Scenes) -> Iterator[tuple[str, ...]]:
    """Yield impulses of 100 afferents under a press at two steps of the signal, and what they cost."""
    stimulus = ramp(0.8, 10.0, 0.6)
    for name, model in BUILT_IN.items():
        skin, gains, totals, cost_s = scenes.probe(name, 1, 100), sensitivities(name, 1, 100), [], 0.0
        for step_s in (1e-3, 2.5e-4):
            total = 0
            for seed in range(5):
                signal = skin.signal(stimulus, step_s, 1.0)
                begun = time.process_time()
                trains = spikes_of(model, signal, gains, [(seed, k) for k in range(100)])
                cost_s = time.process_time() - begun if step_s == 1e-3 else cost_s
                total += sum(map(len, trains))
            totals.append(total / 5)
        yield (
            name,
            *(f"{total:.0f}" for total in totals),
            f"{100 * (totals[1] / totals[0] - 1):+.1f}".replace("-", "−"),
            f"{cost_s:.2f}",
        )


def main(wanted: list[str]) -> None:
    """Print the tables."""
    scenes = Scenes()

    def rows() -> Iterator[Row]:
        for test in TESTS:
            if not wanted or test.__name__ in wanted:
                yield from test(scenes)

    show(HEADER, map(cells, rows()))
    for header, table in ((PARAMETERS, parameters()), (LINEAR, frozen_contact(scenes)), (STEPS, steps(scenes))):
        print()
        show(header, table)


if __name__ == "__main__":
    main(sys.argv[1:])
