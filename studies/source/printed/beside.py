"""Rows of the matrix of which the model alone says nothing: what is missing, or out of scope."""

from rig.report.page import PageFigure
from rig.report.recording_sections import Deflection, deflection_section
from studies.source.printed.answers import FingerAnswers
from studies.source.printed.entry import Entry

LINE_DOIS_MM = (0.5, 1.0, 1.5, 2.0)


def _line(answers: FingerAnswers) -> tuple[PageFigure, ...]:
    results = [answers.finger.indent("line", doi_mm=doi) for doi in LINE_DOIS_MM]
    return deflection_section([Deflection(result.doi_mm, *result.axial_profile) for result in results], []).figures


COMPARED = ".venv/bin/rig compare RUN… --recorded SHAPE=FILE"

BEFORE = (
    Entry(
        "ch. 3, line load",
        "The skin's deflection under a line load across the finger, against measured fingers.",
        figures=_line,
        missing="the measured deflections, as a CSV of z_mm,deflection_mm",
        made_by=".venv/bin/rig indent --shape line --z-mm 6.893 --doi-mm 1 --deflection FILE",
        reading="The simulation is drawn at four depths; the source printed the measurements as a figure.",
    ),
)
RECORDED = tuple(
    Entry(
        number,
        shows,
        missing=f"the recorded profiles of {who}, as CSVs of position_mm,rate",
        made_by=COMPARED,
        reading="The numbers of the figures for steps and for bars are inferred from their order.",
    )
    for number, shows, who in (
        ("5-8, 5-9", "Profiles under steps against recorded discharge rates.", "Srinivasan & LaMotte 1987"),
        ("5-12, 5-13", "Profiles under bars against recorded discharge rates.", "Phillips & Johnson 1981"),
        ("Table 5.1", "Its numbers come from the recorded profiles.", "both"),
    )
)
OUTSIDE = (
    Entry("psychophysics", "What people feel of such shapes.", outside="the model ends at the receptor", made_by="–"),
    Entry(
        "transduction",
        "How strain becomes an impulse in a nerve's end.",
        outside="the model ends at the receptor",
        made_by="–",
    ),
)
