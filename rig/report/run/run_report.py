"""One self-contained HTML file for a run."""

import json
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from rig.data import Run
from rig.data.bench_time import booked_s
from rig.data.folder import replace_text
from rig.plan.responses import Response, by_group, responses
from rig.report.html import Figure, figures_of, render
from rig.report.run import run_figures
from rig.report.run.contact_picture import PICTURES_A_PAGE, contacts_from_below, is_relief
from rig.report.style import signed
from sim.models.fingertip import Fingertip


def write_report(
    run: Run, finger: Fingertip, wall_s: float | None = None, ending: Mapping[str, str] | None = None
) -> Path:
    """Write report.html into the run's folder; a run without a finished indentation gets its tables only.

    ending: what is to be said of a run that ended before its end, by what it is about.
    """
    found = responses(run, finger)
    text = render(
        "run.html.j2",
        run=run,
        found=found,
        figures=_figures(run, found) if found else [],
        phases=_phase_durations(run),
        provenance=json.loads(run.folder.provenance.read_text(encoding="utf-8")),
        checksums=_checksums(run),
        finger=finger,
        wall_s=wall_s,
        ending=ending,
    )
    replace_text(run.folder.report, text)
    return run.folder.report


def _figures(run: Run, found: list[Response]) -> list[Figure]:
    shown = _contact_figures(run, found)
    moved = any(len(members) > 1 for members in by_group(found).values())
    return [*shown, *_ssrp_figures(found)] if moved else shown


def _contact_figures(run: Run, found: list[Response]) -> list[Figure]:
    last = [response for response in found if response.last]
    return [
        Figure(
            "Force against depth",
            run_figures.force_doi(run),
            "As read by the force sensor against the depth from the contact fitted at each touch-off. "
            "One line for each indentation, coloured by the indentor's position.",
        ),
        *figures_of(
            "Contact at each position",
            last,
            run_figures.CONTACTS_A_PAGE,
            partial(run_figures.contact_panels, top=run_figures.highest_pressure(last)),
            "Black: the indentor. Grey: the deformed skin in the receptor plane. Orange: contact regions. "
            "Blue, right axis: nodal pressure against undeformed x, unfiltered, in pseudo-units "
            "(E of the epidermis = 10 000). The last hold of each indentation.",
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
            "titles name, or, where one place was pressed, for each depth or force.",
        ),
    ]


def _title(response: Response) -> str:
    result = response.result
    return f"x = {signed(result.x_mm)}, {result.force_gwt:.2f} gwt, DOI {result.doi_mm:.3f} mm"


def _ssrp_figures(found: list[Response]) -> list[Figure]:
    return [
        Figure(
            "SSRP of ep1",
            run_figures.ssrps(found, "ep1"),
            "Simulated spatial response profiles: −ep1 at one receptor against the indentor's "
            "position, one line for each depth or force. Dotted: the receptor's own x.",
        ),
        Figure(
            "SSRP of strain energy density",
            run_figures.ssrps(found, "sed"),
            "As above, for the strain energy density in pseudo-units.",
        ),
    ]


def _phase_durations(run: Run) -> list[tuple[str, float]]:
    """What the time of the run's clock went to."""
    return list(booked_s(run).items())


def _checksums(run: Run) -> list[tuple[str, str]]:
    path: Any = run.folder.path / "SHA256SUMS"
    if not path.exists():
        return []
    pairs = [line.split("  ", 1) for line in path.read_text(encoding="utf-8").splitlines()]
    return [(name, digest) for digest, name in pairs if name != "report.html"]
