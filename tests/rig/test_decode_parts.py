"""The options of `rig decode`: what each says, what they mean together, how errors name them."""

import pytest

from rig.cli.decode import receptor_of
from rig.errors import BadInputError
from sim.coding.bayes import FittedReceptor
from sim.coding.encoding import Receptor


@pytest.mark.parametrize(
    ("gain", "threshold", "expected"),
    [
        (None, "0", FittedReceptor(Receptor(1.0, 0.0), 0.0, 0.0)),
        ("30", "1.5", FittedReceptor(Receptor(30.0, 1.5), 0.0, 0.0)),
        ("30±2", "1.5±0.25", FittedReceptor(Receptor(30.0, 1.5), 2.0, 0.25)),
        ("3e1+-2e0", "-1.5", FittedReceptor(Receptor(30.0, -1.5), 2.0, 0.0)),
        (None, None, None),
    ],
)
def test_a_receptor_with_its_errors(gain: str | None, threshold: str | None, expected: FittedReceptor | None) -> None:
    assert receptor_of(gain, threshold) == expected


@pytest.mark.parametrize("text", ["1.1e9", "3±1±1", "2±", "2+-nan", "2±-1", "inf", ""])
def test_what_is_no_gain_is_refused(text: str) -> None:
    with pytest.raises(BadInputError, match="--gain"):
        receptor_of(text, "0")
