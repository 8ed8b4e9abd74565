"""The parts of a comparison's report that do without figures of their own: what is written in them."""

from collections.abc import Callable

import numpy as np
import pytest

from rig.compare.comparison import Comparison, compare
from rig.compare.recordings.recording import Recording, recording
from rig.compare.stimuli import StimulusRow
from rig.report.comparison_report import measures_section
from rig.report.plot import Plot, Subplot, guide
from rig.report.recording_sections import Deflection, deflection_section, source_section, table_5_1
from rig.report.style import label
from sim.measures.measures import BY_NAME, MEASURES

X = np.linspace(-4, 3, 25)
RECEPTORS = np.array([-1.0, 0.0, 1.0])
STEP = np.exp(-((X[:, None] - RECEPTORS) ** 2)) - 0.4 * np.exp(-((X[:, None] - RECEPTORS + 2) ** 2)) + 0.5
BAR = np.exp(-((X[:, None] - RECEPTORS - 1) ** 2)) + np.exp(-((X[:, None] - RECEPTORS + 1) ** 2))

Make = Callable[..., StimulusRow]


def measured(factor: float = 50.0, name: str = "mine.csv") -> Recording:
    """Rates that rise with the step's profile at the receptor −1, in straight lines."""
    places = np.linspace(-1.5, 1.5, 16)
    eps = np.interp(places - 1.0, X, STEP[:, 0])
    return recording(name, [(float(x), factor * float(e), 1.0) for x, e in zip(places, eps, strict=True)])


@pytest.fixture
def steps(make_stimulus: Make) -> list[StimulusRow]:
    """The source's steps at 8 gwt; ep1 has the recorded form, ep3 and s22 rise with it, SED is flat."""
    return [
        make_stimulus(
            f"step:{n}", X, RECEPTORS, {"ep1": STEP, "ep3": STEP**2, "s22": 3 * STEP}, commanded=8.0, run=f"r{n}"
        )
        for n in "135"
    ]


def test_every_measure_is_defined_with_unit_sign_and_range(steps: list[StimulusRow]) -> None:
    assert len({measure.meaning for measure in BY_NAME.values()}) == len(MEASURES)
    section = measures_section(compare(steps, {}), young_mpa=0.2)
    assert "one pseudo-unit is 2e−05 MPa here" in section.text
    rows = {row[0]: dict(zip(section.header, row, strict=True)) for row in section.rows}
    assert list(rows) == list(MEASURES)
    for name, row in rows.items():
        turned = BY_NAME[name].as_magnitude
        assert row["plotted as"] == f"{label(name)}, {'as magnitude' if turned else 'unchanged'}"
        assert row["share with the other sign"] == ("0 %" if turned else "")
    assert rows["ep1"]["range as plotted"] == f"{STEP.min():.3g} … {STEP.max():.3g}"
    assert (rows["ep1"]["unit"], rows["third"]["unit"]) == ("strain", "pseudo-units³")


def all_recorded(steps: list[StimulusRow], make_stimulus: Make) -> Comparison:
    bars = [
        make_stimulus(
            f"bar:{w}", X, RECEPTORS, {"ep1": BAR, "ep3": BAR**2}, kind="doi_mm", commanded=1.0, run=f"b{w}"
        )
        for w in ("1.5", "3.0")
    ]
    files = {s.shape: measured(50.0, f"{s.shape[-1]}.csv") for s in (*steps, *bars)}
    return compare([*steps, *bars], files)


def test_recordings_fill_figures_and_table(steps: list[StimulusRow], make_stimulus: Make) -> None:
    comparison = all_recorded(steps, make_stimulus)
    section = source_section(comparison)
    assert {row[3] for row in section.rows} == {"filled: 1.csv, 3.csv, 5.csv", "filled: 5.csv, 3.csv", "filled"}
    assert [figure.title.partition(" of")[0] for figure in section.figures] == [
        "Fig. 5-8", "Fig. 5-9", "Fig. 5-12", "Fig. 5-13",
    ]  # fmt: skip
    table = table_5_1(comparison)
    first = dict(zip(table.header, table.rows[0], strict=True))
    assert first == {
        "recordings": "step:1, step:3, step:5 at 8 gwt", "measure": "−ep1", "receptor (mm)": "−1.00",
        "r for each shape": "1  1  1", "k": "50", "ε₀": first["ε₀"], "R²": "1",
    }  # fmt: skip
    assert abs(float(first["ε₀"].replace("−", "-"))) < 1e-9
    assert [(row[0][:4], row[1], row[2]) for row in table.rows] == [
        ("step", "−ep1", "−1.00"), ("step", "ep3", "−1.00"), ("bar:", "−ep1", "0.00"), ("bar:", "ep3", "0.00"),
    ]  # fmt: skip
    assert float(table.rows[1][6]) < 1


def test_a_figure_has_the_same_bytes_each_time() -> None:
    """Its clips and markers have names in SVG, and files have dates."""
    series = [guide("contour", [[0.0, 1.0], [1.0, 3.0]]), guide("plot", [0.0, 1.0], [0.0, 1.0], "o-")]
    one, other = (Plot((3.0, 2.0), [Subplot("x (mm)", "y (mm)", series)]) for _ in range(2))
    assert one.svg == other.svg
    assert one.png == other.png
    assert b"Software" not in one.png
    assert "<dc:date>" not in one.svg


@pytest.mark.parametrize(
    ("measured_mm", "left_out"),
    [
        ([2.0, 4.0, 10.0], ""),
        ([1.0, 4.0, 10.0], "1 point beside the patch of the model is left out"),
        ([1.0, 11.0], "2 points beside the patch of the model are left out"),  # all, at a depth that was pressed
        ([1.0, 4.0, 11.0, 12.0], "3 points beside the patch of the model are left out"),
    ],
)
def test_measured_points_beside_the_patch_are_counted_as_left_out(measured_mm: list[float], left_out: str) -> None:
    z = np.linspace(2.0, 10.0, 30)
    at = np.array(measured_mm)
    elsewhere = Deflection(3.0, at, 0 * at)  # a depth that no run pressed to
    text = deflection_section([Deflection(0.5, z, 0 * z)], [Deflection(0.5, at, 0 * at), elsewhere]).text
    assert left_out in text
    assert ("patch" in text) is bool(left_out)
    assert "No run pressed" not in text
