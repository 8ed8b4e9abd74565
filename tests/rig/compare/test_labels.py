"""How measures and numbers are written."""

from rig.report.style import as_limits, as_number, as_positions, unit
from sim.measures.measures import MEASURES


def test_strains_are_numbers_and_stresses_pseudo_units() -> None:
    units = {name: unit(name) for name in MEASURES}
    assert [name for name, written in units.items() if written == "strain"] == [
        *("e11", "e22", "e33", "e12", "e23", "e13", "ep1", "ep2", "ep3")
    ]
    assert units["third"] == "pseudo-units³"
    assert units["sed"] == units["s11"] == "pseudo-units"


def test_numbers_of_a_table() -> None:
    assert as_limits([-1.25, 2.0]) == "[−1.25, 2]"
    assert as_limits([None, 3.0]) == "[–, 3]"
    assert as_limits(None) == ""
    assert [as_number(v) for v in (None, 99999.0, 123456.0)] == ["–", "100000", "1.23e+05"]
    assert as_positions([-1.25, -0.0001]) == "−1.25 0"
    assert as_positions([]) == "–"
