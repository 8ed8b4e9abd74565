"""Arguments of the library that only a Python caller can get wrong: each has one line, not the error of a package."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from sim import Aim, Fingertip, Tissue, choose, load, to_pandas
from sim.errors import ArgumentError
from tests.error_codes import raises


@pytest.fixture(scope="module")
def simple() -> Fingertip:
    """The cheapest model."""
    return load("halfspace")


@pytest.mark.parametrize("name", ["x_mm", "z_mm", "doi_mm", "force_gwt"])
@pytest.mark.parametrize("value", [np.array([0.2, 0.3]), "0.2"])
def test_a_press_takes_one_number_of_each(simple: Fingertip, name: str, value: Any) -> None:
    given = {"x_mm": 0.0, name: value} | ({} if name in ("doi_mm", "force_gwt") else {"doi_mm": 0.2})
    for call in (lambda: simple.indent("bar:3.0", **given), lambda: choose("bar:3.0", **given)):
        with raises(ArgumentError, "not_a_number", name=name, kind=type(value).__name__):
            call()


@pytest.mark.parametrize("value", [np.array(0.2), np.int64(1)])
def test_a_number_is_one_of_any_kind(simple: Fingertip, value: Any) -> None:
    assert simple.indent("sphere:4", doi_mm=value).force_gwt > 0


ARRAY: Any = np.zeros((5, 5))
PATH: Any = "finger.toml"
TISSUE: Any = Tissue()


def _pressed() -> Any:
    return load("halfspace").indent("sphere:4", doi_mm=0.2)


@pytest.mark.parametrize(
    ("call", "code", "kind"),
    [
        (lambda: load("halfspace").indent(ARRAY, doi_mm=0.2), "no_indentor", "ndarray"),
        (lambda: Fingertip.load(PATH), "no_finger_config", "str"),
        (lambda: load("halfspace", TISSUE), "no_finger_config", "Tissue"),
        (lambda: choose("bar:3.0", doi_mm=0.2, config=TISSUE), "no_finger_config", "Tissue"),
        (lambda: to_pandas(_pressed()), "no_table", "IndentationResult"),
    ],
)
def test_a_wrong_kind_is_named(call: Callable[[], Any], code: str, kind: str) -> None:
    with raises(ArgumentError, code, kind=kind):
        call()


def test_an_unknown_model_is_told_with_the_known_ones() -> None:
    with raises(ArgumentError, "unknown_model", known="halfspace, section, finger"):
        load("fingr")  # type: ignore[arg-type]


def test_one_quantity_needs_no_tuple() -> None:
    assert Aim("force") == Aim(("force",))  # type: ignore[arg-type]
