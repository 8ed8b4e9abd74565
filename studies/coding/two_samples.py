"""Two pressures read back from noisy SED: the source's decoder, converged, and ours, on the same draws.

    .venv/bin/python -m studies.coding.two_samples [DRAWS] [chosen]

Off-grid truths from U(0, 30)² and from [20 14] ± 3; neither decoder is told which. Error is Eq. 6.8 (squared), noise
is of the SNR over M samples. The limit is of a reader who is told the distribution (`limits.py`). With `chosen`: the
draws on which the prior was chosen, none of which are reported. Then the worked example on grids: where it sticks,
and two more decoders.
"""

import sys
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from sim.coding.bayes import decode_profile
from sim.coding.decoder_results import Decoded, decoding_errors
from sim.coding.decoders_by_search import PressureRange, converged_search, global_search, grid_search, table_search
from sim.coding.encoding import Encoded, Noise, encode
from sim.coding.operators import ForwardOperator, convolution, impulse_responses
from sim.coding.receptor_readings import Readings
from sim.coding.section import Sampling, sampled_section
from sim.config import FingertipConfig
from studies.coding.limits import bayes_found

Array = NDArray[np.float64]

SNR_DB = (0, 5, 10, 15, 20, 30, 40)
DRAWS = 40
SEED, CHOSEN_SEED = 500, 0
TRUE, START = np.array([20.0, 14.0]), np.array([10.0, 10.0])
WITHIN = PressureRange(0.0, 60.0)
RANGE = PressureRange(0.0, 30.0)
"""Of the worked example."""
GRID_STEPS = (3.0, 1.0, 0.3, 0.1, 0.03, 0.01)
TRUTHS: dict[str, Callable[[np.random.Generator], Array]] = {
    "U(0, 30)²": lambda rng: rng.uniform(0.0, 30.0, 2),
    "[20 14] ± 3": lambda rng: TRUE + rng.uniform(-3.0, 3.0, 2),
}
ENDS = {"U(0, 30)²": (np.zeros(2), np.full(2, 30.0)), "[20 14] ± 3": (TRUE - 3, TRUE + 3)}
"""Between which the truths are even."""


def main(draws: int = DRAWS, seed: int = SEED) -> None:
    """Print both tables."""
    operator = sampled_operator()
    seeds = f"{draws} draws a row, seeds {seed} … {seed + draws - 1}"
    print(f"M = {operator.parts.shape[1]} samples, {seeds}; Eq. 6.8, mean ± sd; paired, mean ± its error")
    head = "| truths | SNR (dB) | univariate, converged | ours | limit | paired | ms, ours |"
    print(f"{head}\n|---|---|---|---|---|---|---|")
    for name in TRUTHS:
        for snr_db in SNR_DB:
            print(f"| {name} | {snr_db} | {_row(operator, name, snr_db, range(seed, seed + draws))} |", flush=True)
    print("\n| decoder of [20 14] without noise, from [10 10] | found | Eq. 6.8 | moves |\n|---|---|---|---|")
    for name, found in worked_example(operator).items():
        squared = decoding_errors(TRUE, found.pressure).eq_6_8
        print(f"| {name} | {np.round(found.pressure, 2)} | {squared:.2g} | {max(0, len(found.path) - 1)} |")


def sampled_operator() -> ForwardOperator:
    """Two pressures on the default finger's section."""
    return convolution(impulse_responses(sampled_section(FingertipConfig(), Sampling())), len(TRUE), "finite")


def drawn(operator: ForwardOperator, truths: str, snr_db: int, seed: int) -> tuple[Array, Encoded]:
    """Two pressures and their noisy SED."""
    true = TRUTHS[truths](np.random.default_rng((seed, snr_db)))
    return true, encode(operator, true, None, Noise(snr_db, seed=seed + 1000 * snr_db))


def converged_error(operator: ForwardOperator, true: Array, said: Encoded) -> float:
    """Eq. 6.8 of the source's search, converged."""
    return decoding_errors(true, converged_search(operator, said.rate, START, WITHIN).pressure).eq_6_8


def errors_of(operator: ForwardOperator, truths: str, snr_db: int, seeds: range) -> tuple[Array, float]:
    """(3, draws) Eq. 6.8 of the converged search, of ours and of the limit; ms of ours a draw."""
    errors, spent_s = np.empty((3, len(seeds))), 0.0
    for k, seed in enumerate(seeds):
        true, said = drawn(operator, truths, snr_db, seed)
        errors[0, k] = converged_error(operator, true, said)
        began = time.process_time()
        errors[1, k] = decoding_errors(true, _ours(operator, said)).eq_6_8
        spent_s += time.process_time() - began
        told = bayes_found(operator, said.rate, said.noise_sd, ENDS[truths])
        errors[2, k] = decoding_errors(true, told).eq_6_8
    return errors, 1e3 * spent_s / len(seeds)


def _row(operator: ForwardOperator, truths: str, snr_db: int, seeds: range) -> str:
    errors, spent_ms = errors_of(operator, truths, snr_db, seeds)
    apart = errors[1] - errors[0]
    cells = [f"{e.mean():.4f} ± {e.std(ddof=1):.4f}" for e in errors]
    cells.append(f"{apart.mean():+.4f} ± {apart.std(ddof=1) / np.sqrt(len(seeds)):.4f}")
    return " | ".join([*cells, f"{spent_ms:.0f}"])


def _ours(operator: ForwardOperator, said: Encoded) -> Array:
    return decode_profile(operator, Readings.of_sed(said.rate, said.noise_sd)).pressure


def worked_example(operator: ForwardOperator) -> dict[str, Decoded]:
    """[20 14] from [10 10] without noise, by every decoder; a second or two."""
    reading = operator.sed(TRUE)
    grids = {
        f"univariate, grid of {step:g}": grid_search(operator, reading, START, RANGE, step) for step in GRID_STEPS
    }
    return {
        **grids,
        "univariate, converged": converged_search(operator, reading, START, RANGE),
        "table of 1 000 responses": table_search(operator, reading, RANGE, 1000),
        "scipy's dual annealing": global_search(operator, reading, RANGE),
    }


if __name__ == "__main__":
    numbers = [int(word) for word in sys.argv[1:] if word.isdigit()] or [DRAWS]
    main(numbers[0], CHOSEN_SEED if "chosen" in sys.argv else SEED)
