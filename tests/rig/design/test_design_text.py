"""A design that is shortened to fit into its session says only what is true of the presses that are left."""

from rig.design.design import DESIGNED, DesignRequest, _designed, shortened, with_own_outcome
from rig.design.design_text import about_the_design, headline
from rig.design.press_times import PressTimes
from rig.design.response_table import ResponseTable
from rig.plan.config import Config

MINUTES = 3.0


def test_a_shortened_design_has_the_outcome_of_the_presses_that_are_left(
    table: ResponseTable, times: PressTimes
) -> None:
    """The script leaves out presses that the rehearsal has no time for: no number of the longer design is kept."""
    request = DesignRequest(
        ("ep1", "sed", "e22"), ("bar:1.5", "bar:3.0"), MINUTES, targets=(0.25, 0.5, 1.0), quick=True
    )
    found = _designed(request, Config(), table, times, len(table.presses), lambda *_: None)
    presses = len(found.made.order)
    shorter = with_own_outcome(shortened(found, presses - 4))
    assert len(shorter.presses) == shorter.outcome.presses == presses - 4
    assert headline(shorter).startswith(f"{presses - 4} presses")
    assert f"{presses - 4} presses in 3 minutes" in about_the_design(shorter)
    assert [one for one in shorter.outcomes if one.name != DESIGNED] == [
        one for one in found.outcomes if one.name != DESIGNED
    ]
