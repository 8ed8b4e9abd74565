"""One self-contained HTML file for a run."""

import json
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from rig.data import Run
from rig.data.folder import replace_text
from rig.plan.responses import Response, by_group, responses
from rig.report.html import Figure, figures_of, render
from rig.report.run import contact_figures, force_figures, run_figures, what_ran
from rig.report.run.conditions import Condition, by_target, conditions
from rig.report.run.contact_picture import PICTURES_A_PAGE, contacts_from_below, is_relief
from rig.report.run.met_finger import met_finger
from rig.report.run.numbers import numbers_missing, write_numbers
from rig.report.style import signed
from sim.models.fingertip import Fingertip

_KPA_PER_MPA = 1000


def write_report(
    run: Run, finger: Fingertip, wall_s: float | None = None, ending: Mapping[str, str] | None = None
) -> Path:
    """Write report.html into the run's folder, and the model's numbers beside it.

    A run without a finished indentation gets its tables only. ending: what is to be said of a run that ended before
    its end, by what it is about.
    """
    found = responses(run, finger)
    if found:
        write_numbers(run, found)
    return _write_page(run, finger, found, wall_s, ending)


def write_missing(run: Run, finger: Fingertip) -> None:
    """Of report and numbers what is not there; the rest stays as it is."""
    found = responses(run, finger)
    if found:
        write_numbers(run, found, again=False)
    if not run.folder.report.exists():
        _write_page(run, finger, found, None, None)


def lacks_report(run: Run) -> bool:
    """Whether the report, or numbers behind its figures, are missing."""
    return not run.folder.report.exists() or (bool(run.done) and numbers_missing(run))


def _write_page(
    run: Run, finger: Fingertip, found: list[Response], wall_s: float | None, ending: Mapping[str, str] | None
) -> Path:
    provenance = json.loads(run.folder.provenance.read_text(encoding="utf-8"))
    text = render(
        "run.html.j2",
        run=run,
        found=what_ran.one_by_one(run, found),
        conditions=what_ran.condition_rows(run, found),
        figures=_figures(run, found, finger),
        small_strain=_small_strain(found),
        phases=what_ran.phases(run),
        why_approach=what_ran.why_approach(run),
        met=met_finger(run, finger),
        limits=what_ran.limits(run),
        devices=what_ran.devices(run, provenance),
        provenance=provenance,
        checksums=_checksums(run),
        finger=finger,
        wall_s=wall_s,
        ending=ending,
    )
    replace_text(run.folder.report, text)
    return run.folder.report


def _figures(run: Run, found: list[Response], finger: Fingertip) -> list[Figure]:
    read = any(run.stream(stream) for stream in force_figures.SAMPLES)
    over_time = [_over_time(run)] if read else []
    if not found:
        return over_time
    moved = any(len(members) > 1 for members in by_group(found).values())
    pressed = [*over_time, *_press_figures(run), *_contact_figures(run, found, finger)]
    return [*pressed, *_ssrp_figures(found)] if moved else pressed


def _small_strain(found: Sequence[Response]) -> str:
    """Of the deepest of the model's answers; nothing where there is none."""
    deepest = max((response.result for response in found), key=lambda result: result.doi_mm, default=None)
    return "" if deepest is None else deepest.small_strain.note


def _over_time(run: Run) -> Figure:
    return Figure(
        "Force against time",
        force_figures.force_time(run),
        "Every reading of the run; grey: presses that are no data. Below: what the time went to; white is what moved "
        "sideways, rested, was zeroed or waited for. Numbers: sample.csv.",
    )


def _press_figures(run: Run) -> list[Figure]:
    return [
        Figure(
            "Press, hold and relaxation",
            force_figures.presses(run),
            "Left: force from the beginning of each press, all repeats. Right: force in each hold over its first "
            "reading. Coloured by the indentor's position. Numbers: sample.csv.",
        ),
        Figure(
            "Force against depth",
            force_figures.force_depth(run),
            "While pressing, against the depth from the contact fitted at each touch-off. Left: the mean of each "
            "condition's repeats, on the depths that all of them reached. Right: their standard deviation. "
            "Numbers: sample.csv.",
        ),
    ]


def _contact_figures(run: Run, found: list[Response], finger: Fingertip) -> list[Figure]:
    last = [response for response in found if response.last]
    top, kpa = contact_figures.highest_pressure(last), finger.e_epidermis_mpa * _KPA_PER_MPA / 10
    caption = (
        "Black: the indentor. Grey: the deformed skin in the receptor plane. Orange: contact regions. Blue: nodal "
        "pressure against undeformed x, unfiltered, in pseudo-units (E of the epidermis = 10 000); 1 000 of them are "
        f"{kpa:.3g} kPa on this finger. Repeats lie over one another. The last hold of each indentation. Numbers: "
        "model_contact.csv, model_pressure.csv."
    )
    return [
        *(
            figure
            for name, members in by_target(conditions(run)).items()
            for figure in figures_of(
                f"Contact, {name}",
                _repeats(members, last),
                contact_figures.CONTACTS_A_PAGE,
                partial(contact_figures.contact_panels, top=top),
                caption,
            )
        ),
        *figures_of(
            "Contact as seen from the finger",
            [response for response in last if is_relief(response.result.indentor)],
            PICTURES_A_PAGE,
            lambda part: contacts_from_below([r.result for r in part], [_title(r) for r in part]),
            "Nodal pressure over x and z, the finger's tip up; grey: lines of equal height of the indentor, orange: "
            "places that bear, dotted: the receptor plane. The last hold of each indentation.",
        ),
        Figure(
            "Population responses",
            run_figures.population_responses(found),
            "−ep1 (compression is plotted upwards) and strain energy density at the receptors, "
            f"{found[0].result.model.receptors.depth_mm:g} mm below the skin: one line for each position of what the "
            "titles name, or, where one place was pressed, for each depth or force. Numbers: model_measures.csv.",
        ),
    ]


def _repeats(members: Sequence[Condition], last: Sequence[Response]) -> list[list[Response]]:
    """The answers to each condition's repeats."""
    by_index = {response.index: response for response in last}
    return [[by_index[index] for index in condition.indices] for condition in members]


def _title(response: Response) -> str:
    result = response.result
    return f"x = {signed(result.x_mm)}, {result.force_gwt:.2f} gwt, DOI {result.doi_mm:.3f} mm"


def _ssrp_figures(found: list[Response]) -> list[Figure]:
    return [
        Figure(
            "SSRP of ep1",
            run_figures.ssrps(found, "ep1"),
            "Simulated spatial response profiles: −ep1 at one receptor against the indentor's position, the mean of "
            "repeats, one line for each depth or force. Dotted: the receptor's own x. Numbers: model_measures.csv.",
        ),
        Figure(
            "SSRP of strain energy density",
            run_figures.ssrps(found, "sed"),
            "As above, for the strain energy density in pseudo-units.",
        ),
    ]


def _checksums(run: Run) -> list[tuple[str, str]]:
    path: Any = run.folder.path / "SHA256SUMS"
    if not path.exists():
        return []
    pairs = [line.split("  ", 1) for line in path.read_text(encoding="utf-8").splitlines()]
    return [(name, digest) for digest, name in pairs if name != "report.html"]
