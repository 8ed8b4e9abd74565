"""The sections of the study that need no finger: they import, they draw, and they become Markdown."""

from collections.abc import Callable

import numpy as np

from rig.compare.comparison import compare
from rig.compare.stimuli import Stimulus
from rig.report.html import Section
from sim.measures.measures import MEASURES
from sim.measures.receptors import DEFAULT_X_MM
from studies.source.pages import markdown
from studies.source.table_agreement import survivors_section, table_5_2
from studies.source.verdicts_by_parameter import FORCES_GWT, HEADER, VARIANTS, Verdicts, sensitivity_section

X_MM = np.array([-1.5, -1.3, -1.1, -0.9, -0.7, -0.5])
PEAK_THEN_DIP = np.array([1.0, 0.6, 0.2, 1.0, 3.0, 1.0])  # from right to left, as steps are moved


def test_a_table_as_the_docs_have_it() -> None:
    section = Section("Facts", "What comes out.", ("fact", "here"), (("1", "left | right"), ("2", "−3")))
    assert markdown(section) == (
        "**Facts.** What comes out.\n\n| fact | here |\n| --- | --- |\n| 1 | left | right |\n| 2 | −3 |\n"
    )


def test_every_variant_and_force_has_a_row_and_a_column() -> None:
    found = [Verdicts(v, f, ("ep1", "sed"), ("ep1",), 0.5) for v in VARIANTS for f in FORCES_GWT]
    section = sensitivity_section(found)
    assert section.header == HEADER
    assert section.rows[0] == ("default", "2.33", "ep1, sed", "ep1", "0.50")
    assert len(section.rows) == 14
    assert section.figures[0].plot.svg.startswith("<?xml")
    assert Verdicts("x", 8.0, (), (), 0.0).row == ("x", "8", "none", "none", "0.00")


def test_table_5_2_counts_cells(make_stimulus: Callable[..., Stimulus]) -> None:
    """ep1 passes at −1.0 only, under all three steps; the source has it there and at other receptors, too."""
    receptors = np.array(DEFAULT_X_MM)
    profile = np.where(receptors == -1.0, PEAK_THEN_DIP[:, None], 0.0)
    found = compare([make_stimulus(f"step:{n}", X_MM, receptors, {"ep1": profile}) for n in "135"], {})
    cells, thresholds = table_5_2(found, 2.33)
    row = dict(zip(cells.header, cells.rows[MEASURES.index("ep1")], strict=True))
    assert row["step:1"] == "−(−1.5) −(−1.25) (−1)"  # Raju (1998), Table 5.2: −1, −1.25, −1.5
    assert row["step:5"] == "(−1) −(−0.5)"
    for line in thresholds.rows:
        assert line[1:5] == ("3", "0", "54", "483")  # of 540 cells the source has 57
        assert line[-1] == "ep1"
    assert survivors_section(found).rows[-1] == ("everything above", "ep1")
