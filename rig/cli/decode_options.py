"""What the options of `rig decode` mean, and which of them cannot be meant together."""

import math
import re
from pathlib import Path

from rig.cli.decode_sources import Encoding
from rig.cli.decoding import DecoderName, Search
from rig.cli.options import numbers
from rig.cli.sampling import bounded, named
from rig.protocol.errors import BadInputError
from sim.coding.bayes import FittedReceptor
from sim.coding.encoding import NOISE_PLACES, Noise, Receptor
from sim.coding.operators import OPERATORS, OperatorName
from sim.coding.section import ENERGIES
from sim.coding.sheet import HALF_LENGTHS_MM

_PLUS_MINUS = re.compile(r"±|\+/?-")
_LARGEST = 1e9
LEAST_MM, MOST_MM = 0.3, 10.0
"""Half-lengths of contacts along the finger."""


def refuse_together(pressure: str | None, shape: str | None, readings: Path | None, **others: object) -> None:
    """Readings have one source, and those of a file their own noise and operator."""
    if [pressure, shape, readings].count(None) != 2:
        raise BadInputError(
            "expected exactly one of {options}", code="exactly_one", options="--pressure, --shape and --readings"
        )
    for name, value in others.items():
        if readings is not None and value is not None:
            raise BadInputError(
                "{option} beside {beside}: expected it with --pressure or --shape",
                code="not_together", option=f"--{name.replace('_', '-')}", beside="--readings",
            )  # fmt: skip


def operator_of(operator: str | None, *, pressures: bool) -> OperatorName:
    """Of pressures by default the source's, of presses and readings by finite elements."""
    return named("--operator", operator or ("convolution" if pressures else "influence"), OPERATORS)


def encoding_of(
    energy: str, noise: str, snr_db: float | None, seed: int, receptor: FittedReceptor | None
) -> Encoding:
    """Raises BadInputError for unknown words and numbers beyond their bounds."""
    at = named("--noise", noise, NOISE_PLACES)
    drawn = int(bounded("--seed", seed, 0, 2**32))
    added = None if snr_db is None else Noise(bounded("--snr-db", snr_db, -40, 100), at, drawn)
    return Encoding(named("--energy", energy, ENERGIES), receptor, added, at)


def receptor_of(gain: str | None, threshold: str | None) -> FittedReceptor | None:
    """R = k (S − S₀) with the standard errors of k and S₀; none without a threshold. Raises BadInputError."""
    if threshold is None:
        if gain is not None:
            raise BadInputError(
                "{option}: expected {needs} beside it", code="needs_option", option="--gain", needs="--threshold"
            )
        return None
    k, k_se = _with_error("--gain", "1" if gain is None else gain)
    s0, s0_se = _with_error("--threshold", threshold)
    bounded("--gain", k, 1e-9, _LARGEST)
    if k_se >= k:
        raise BadInputError(
            "{option} {value}: expected a standard error below the gain itself",
            code="error_too_large", option="--gain", value=gain,
        )  # fmt: skip
    return FittedReceptor(Receptor(k, bounded("--threshold", s0, -_LARGEST, _LARGEST)), k_se, s0_se)


def _with_error(option: str, text: str) -> tuple[float, float]:
    """A number, and its standard error where it has one: 30, 30±2, 30+-2."""
    try:
        value, error = map(float, [*_PLUS_MINUS.split(text), "0"][:2]) if text.count("±") < 2 else (math.nan, 0.0)
    except ValueError:
        value = error = math.nan
    if not (math.isfinite(value) and math.isfinite(error) and error >= 0):
        raise BadInputError(
            "{option} {value!r}: expected a number, or one with its standard error as 30±2",
            code="not_a_number", option=option, value=text,
        )  # fmt: skip
    return value, error


def search_of(decoder: DecoderName, start: str | None, within: str | None, step: float | None, seed: int) -> Search:
    """Raises BadInputError for what this decoder does not go by."""
    _refuse("--start", start, decoder, ("univariate", "grid"))
    _refuse("--range", within, decoder, ("univariate", "grid", "table", "global"))
    _refuse("--grid-step", step, decoder, ("grid",))
    places = None if start is None else numbers("--start", start)
    ends = None if within is None else numbers("--range", within)
    if ends is not None and not (len(ends) == 2 and 0 <= ends[0] < ends[1] <= _LARGEST):
        raise BadInputError(
            "{option} {value}: expected two ascending numbers, as 0,30",
            code="not_ascending", option="--range", value=within,
        )  # fmt: skip
    if step is not None:
        bounded("--grid-step", step, 1e-6, _LARGEST)
    return Search(places, ends and (ends[0], ends[1]), step, seed)


def axial_of(axial: str | None, decoder: DecoderName, readings: Path | None) -> tuple[float, ...]:
    """Half-lengths of ellipses along the finger, mm, of which readings choose; none where no shape is named."""
    if axial is None:
        return ()
    if readings is None:
        raise BadInputError(
            "{option} without {needs}: expected a row of receptors in the whole finger",
            code="needs_option", option="--axial", needs="--readings",
        )  # fmt: skip
    _refuse("--axial", axial, decoder, ("ours",))
    word, named, length = axial.partition(":")
    if word == "ellipse" and not named:
        return HALF_LENGTHS_MM
    try:
        half = float(length) if word == "ellipse" else math.nan
    except ValueError:
        half = math.nan
    if not LEAST_MM <= half <= MOST_MM:
        raise BadInputError(
            "{option} {value}: expected ellipse, or ellipse:HALF-LENGTH of {low_mm:g} … {high_mm:g} mm",
            code="bad_value", option="--axial", value=axial, low_mm=LEAST_MM, high_mm=MOST_MM,
        )  # fmt: skip
    return (half,)


def _refuse(option: str, value: object, decoder: DecoderName, takers: tuple[DecoderName, ...]) -> None:
    if value is not None and decoder not in takers:
        raise BadInputError(
            "{option} beside --decoder {decoder}: expected {expected}",
            code="not_this_decoder", option=option, decoder=decoder, expected=" or ".join(takers),
        )  # fmt: skip
