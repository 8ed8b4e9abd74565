"""The prior under a plate holds what four people needed: kept presses, a fresh one beside them, and the page."""

from pathlib import Path

import pytest

from studies.identification.under_a_plate import (
    FINGERS,
    FOUR_PEOPLE_GROWTH,
    FOUR_PEOPLE_N,
    drawn,
    kept,
    main,
    pressed,
)

PAGE = Path(__file__).parents[2] / "docs" / "validation" / "identification.md"


@pytest.mark.parametrize("name", FINGERS)
def test_nine_tenths_of_the_prior_hold_the_four_peoples_forces(name: str) -> None:
    """Forces of four people at 1 and 2 mm (Dandekar's data, as printed with the HS2014 model)."""
    for depth, (least, most) in enumerate(FOUR_PEOPLE_N):
        low, high = kept(name).band_n(depth)
        assert low < least < most < high
        assert high / low < 30, "it says something"


def test_on_the_human_sized_finger_forces_grow_as_the_four_peoples() -> None:
    low, high = kept("human").growth
    assert low < FOUR_PEOPLE_GROWTH[0]
    assert FOUR_PEOPLE_GROWTH[1] < high


def test_what_is_kept_is_what_is_pressed_today() -> None:
    """Of one finger, built in full: interpolation of moduli is within a percent (docs/validation/accuracy.md)."""
    assert list(pressed("default", drawn()[0], exact=True)) == pytest.approx(kept("default").force_n[0], rel=0.01)


def test_the_page_has_the_table_that_the_command_prints(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["under_a_plate"])
    main()
    assert capsys.readouterr().out.strip() in PAGE.read_text("utf-8")
