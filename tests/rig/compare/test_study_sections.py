"""The sections of the study that need no finger: they import, they draw, and they become Markdown."""

from collections.abc import Callable

import numpy as np
import pytest

from rig.compare.comparison import compare
from rig.compare.stimuli import StimulusRow
from rig.report.page_parts import Section
from sim.measures.measures import MEASURES
from sim.measures.receptors import DEFAULT_X_MM
from studies.source import shape_test_errors
from studies.source.matrix_page import markdown
from studies.source.shape_test_errors import by_chance_section, perturbed_section
from studies.source.table_agreement import survivors_section, table_5_2, with_limits
from studies.source.verdicts_by_parameter import FORCES_GWT, HEADER, VARIANTS, ParameterVerdicts, sensitivity_section

X_MM = np.array([-1.5, -1.3, -1.1, -0.9, -0.7, -0.5])
PEAK_THEN_DIP = np.array([1.0, 0.6, 0.2, 1.0, 3.0, 1.0])  # from right to left, as steps are moved


def test_a_table_as_the_docs_have_it() -> None:
    section = Section("Facts", "What comes out.", ("fact", "here"), (("1", "left | right"), ("2", "−3")))
    assert markdown(section) == (
        "**Facts.** What comes out.\n\n| fact | here |\n|---|---|\n| 1 | left | right |\n| 2 | −3 |\n"
    )


def test_every_variant_and_force_has_a_row_and_a_column() -> None:
    found = [ParameterVerdicts(v, f, ("ep1", "sed"), ("ep1",), 0.5) for v in VARIANTS for f in FORCES_GWT]
    section = sensitivity_section(found)
    assert section.header == HEADER
    assert section.rows[0] == ("default", "2.33", "ep1, sed", "ep1", "0.50")
    assert len(section.rows) == 14
    assert section.figures[0].plot.svg.startswith("<?xml")
    assert ParameterVerdicts("x", 8.0, (), (), 0.0).row == ("x", "8", "none", "none", "0.00")


def test_table_5_2_counts_cells(make_stimulus: Callable[..., StimulusRow]) -> None:
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


def test_table_5_2_has_its_limits(make_stimulus: Callable[..., StimulusRow]) -> None:
    receptors = np.array(DEFAULT_X_MM)
    profile = np.where(receptors == -1.0, PEAK_THEN_DIP[:, None], 0.0)
    found = compare([make_stimulus(f"step:{n}", X_MM, receptors, {"ep1": profile}) for n in "135"], {})
    _, thresholds = table_5_2(found, 2.33)
    precision, recall, _ = thresholds.rows[0][5:8]
    assert precision == "1.00 (1.00 … 1.00; 1.00 … 1.00)"  # all of ours are the source's, whichever are drawn
    assert recall.startswith("0.05 (0.00 … 0.")  # 3 of 57
    assert "540 cells are not 540 observations" in thresholds.text
    assert with_limits(-0.5, [(-1.0, 0.0)]) == "−0.50 (−1.00 … 0.00)"
    assert (
        ParameterVerdicts("x", 8.0, (), (), 0.5, ((0.4, 0.6), (0.3, 0.7))).row[-1]
        == "0.50 (0.40 … 0.60; 0.30 … 0.70)"
    )


def test_errors_of_the_shape_test(make_stimulus: Callable[..., StimulusRow], monkeypatch: pytest.MonkeyPatch) -> None:
    """A profile with a peak and a deep enough dip is lost to some perturbations; a flat one gains little from 1 %."""
    monkeypatch.setattr(shape_test_errors, "DRAWS", 50)
    monkeypatch.setattr(shape_test_errors, "EACH", 5)
    x = np.arange(-3, 3, 0.17)
    hump = np.exp(-((x / 0.6) ** 2))[:, None]
    wave = (np.exp(-(((x - 1) / 0.6) ** 2)) - 0.5 * np.exp(-(((x + 1) / 0.6) ** 2)))[:, None]
    stimuli = [
        make_stimulus("step:1", x, np.array([0.0]), {"ep1": hump, "sed": wave}),
        make_stimulus("bar:3.0", x, np.array([0.0]), {"ep1": hump, "sed": np.cos(3 * x)[:, None]}),
    ]
    chance = by_chance_section(stimuli)
    assert [row[0] for row in chance.rows] == ["0.25 mm", "0.5 mm", "1 mm", "2 mm", "as its own"]
    assert float(chance.rows[0][1]) > float(chance.rows[3][1])
    assert " at " in chance.rows[4][1]
    perturbed = perturbed_section(stimuli)
    assert len(perturbed.rows) == 8
    assert len(perturbed.header) == len(perturbed.rows[0]) == 8
    assert float(perturbed.rows[0][2]) < float(perturbed.rows[7][2])  # 1 % of smooth against 10 % of rough
    assert perturbed.rows[0][3] == "0.0"
