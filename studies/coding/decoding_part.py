"""Decoding two pressures: the worked example, the search's way, grids, and noise (Figs 6-8 to 6-12)."""

import time
from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.report.coding_figures import ErrorSurface, cloud_figure, extents, grid_figure, noise_figure, search_figure
from rig.report.page import PageFigure, Section
from sim.coding.bayes import decode_profile
from sim.coding.encoding import Encoded, Noise, Readings, encode
from sim.coding.operators import ForwardOperator, convolution, impulse_responses
from sim.coding.search_decoders import (
    PressureRange,
    converged_search,
    decoding_errors,
    error_surface,
    global_search,
    grid_search,
    table_search,
)
from sim.coding.section import Sampling, sampled_section
from sim.config import FingertipConfig
from studies.coding.limits import bayes_found
from studies.coding.two_samples import ENDS, SEED, SNR_DB, START, TRUE, TRUTHS, WITHIN

Array = NDArray[np.float64]
Row = tuple[str, ...]

DRAWS = 40
"""Of the noise, for each cell of a table, unless more are asked for."""

CLOUD_SNR_DB = (30, 20, 10)
DECODERS = ("univariate, grid of 1", "univariate, converged", "ours")
_RANGE = PressureRange(0.0, 30.0)  # of the worked example
GRID_STEPS = (3.0, 1.0, 0.3, 0.1, 0.03, 0.01)
_ACROSS = 81  # values of a surface's axis


class Searched(NamedTuple):
    """The worked example: [20 14] from [10 10], without noise."""

    surfaces: dict[str, ErrorSurface]
    paths: dict[str, Array]
    grid_errors: Array
    converged_error: float
    rows: Sequence[Row]
    samples: int


class NoisyDecoding(NamedTuple):
    """Pressures found and errors, one truth and SNR."""

    found: Array  # (decoders, draws, 2)
    errors: Array  # (decoders, draws) Eq. 6.8
    ours_ms: float
    limit: float  # mean error of a reader who is told the distribution; none of the worked example


@cache
def _operator() -> ForwardOperator:
    return convolution(impulse_responses(sampled_section(FingertipConfig(), Sampling())), len(TRUE), "finite")


def searched() -> Searched:
    """A second or two of one core."""
    operator = _operator()
    reading = operator.sed(TRUE)
    grids = {step: grid_search(operator, reading, START, _RANGE, step) for step in GRID_STEPS}
    exact = converged_search(operator, reading, START, _RANGE)
    others = {
        **{f"univariate, grid of {step:g}": found for step, found in grids.items()},
        "univariate, converged": exact,
        "table of 1 000 responses": table_search(operator, reading, _RANGE, 1000),
        "scipy's dual annealing": global_search(operator, reading, _RANGE),
    }
    ends = {"the whole range": (np.zeros(2), np.full(2, _RANGE.high)), **extents(exact.path)}
    rows = [
        (
            name,
            f"[{found.pressure[0]:.2f} {found.pressure[1]:.2f}]",
            f"{decoding_errors(TRUE, found.pressure).eq_6_8:.2g}",
            f"{decoding_errors(TRUE, found.pressure).relative_l2:.2%}",
            str(max(0, len(found.path) - 1) or "–"),
            f"[{found.path[1][0]:.1f} {found.path[1][1]:.1f}]" if len(found.path) else "–",
        )
        for name, found in others.items()
    ]
    return Searched(
        {title: _surface(operator, reading, low, high) for title, (low, high) in ends.items()},
        {"exact along each coordinate": exact.path, "grid of 1": grids[1.0].path},
        np.array([decoding_errors(TRUE, grids[step].pressure).eq_6_8 for step in GRID_STEPS]),
        decoding_errors(TRUE, exact.pressure).eq_6_8,
        rows,
        operator.parts.shape[1],
    )


def _surface(operator: ForwardOperator, reading: Array, low: Array, high: Array) -> ErrorSurface:
    first, second = (np.linspace(a, b, _ACROSS) for a, b in zip(np.maximum(low, 0.0), high, strict=True))
    return ErrorSurface(first, second, error_surface(operator, reading, first, second))


def noisy(truths: str, snr_db: int, draws: int) -> NoisyDecoding:
    """Draws that no decoder is told about: of a distribution, or of the worked example itself where there is none."""
    operator, spent_s, limits = _operator(), 0.0, []
    found, true = np.empty((len(DECODERS), draws, 2)), np.empty((draws, 2))
    for k in range(draws):
        true[k], said = _drawn(truths, snr_db, SEED + k)
        found[0, k] = grid_search(operator, said.rate, START, WITHIN, 1.0).pressure
        found[1, k] = converged_search(operator, said.rate, START, WITHIN).pressure
        began = time.process_time()
        found[2, k] = decode_profile(operator, Readings.of_sed(said.rate, said.noise_sd)).pressure
        spent_s += time.process_time() - began
        if truths:
            told = bayes_found(operator, said.rate, said.noise_sd, ENDS[truths])
            limits.append(decoding_errors(true[k], told).eq_6_8)
    errors = ((found - true) ** 2).sum(axis=-1) / (true**2).sum(axis=-1)
    return NoisyDecoding(found, errors, 1e3 * spent_s / draws, float(np.mean(limits)) if limits else np.nan)


def converged_errors(truths: str, snr_db: int, draws: int) -> Array:
    """(draws,) Eq. 6.8 of the converged search alone, on the same draws."""
    found = (_drawn(truths, snr_db, SEED + k) for k in range(draws))
    return np.array(
        [
            decoding_errors(true, converged_search(_operator(), said.rate, START, WITHIN).pressure).eq_6_8
            for true, said in found
        ]
    )


def _drawn(truths: str, snr_db: int, seed: int) -> tuple[Array, Encoded]:
    true = TRUTHS[truths](np.random.default_rng((seed, snr_db))) if truths else TRUE
    return true, encode(_operator(), true, None, Noise(snr_db, seed=seed + 1000 * snr_db))


def search_sections(found: Searched) -> list[Section]:
    """The worked example."""
    return [
        Section(
            "Decoding: two pressures without noise",
            f"P = [20 14] from [10 10], M = {found.samples} samples, SED finite. The source: after its first move "
            "[24 10] (a "
            "half-space gives 23.8), then it zig-zags along a narrow valley to [20 14]; on coarse grids it sticks. "
            "Error is "
            "Eq. 6.8, squared, and relative L2.",
            ("decoder", "found", "Eq. 6.8", "relative L2", "moves", "after the first move"),
            tuple(found.rows),
            (
                PageFigure(
                    "The error surface and the ways over it",
                    search_figure(found.surfaces, found.paths, TRUE),
                    "After Figs 6-8 and 6-9. Grey: decades of the squared error. White dot: start; square: end; "
                    "star: truth.",
                ),
                PageFigure(
                    "The univariate search on grids",
                    grid_figure(np.array(GRID_STEPS), found.grid_errors, found.converged_error),
                    "The source's search takes values of a grid; with steps of a tenth of a pseudo-unit it still "
                    "sticks.",
                ),
            ),
        )
    ]


def noise_sections(
    by_truths: dict[str, dict[int, NoisyDecoding]], clouds: dict[int, NoisyDecoding], samples: int
) -> list[Section]:
    """Error against noise, and where single draws end."""
    draws = next(iter(clouds.values())).errors.shape[1]
    rows = tuple(_noise_row(truths, snr, one) for truths, by in by_truths.items() for snr, one in by.items())
    figures = [
        PageFigure(
            f"Error against noise, truths from {truths}",
            noise_figure(
                np.array(list(by), dtype=float),
                {name: np.stack([one.errors[k] for one in by.values()]) for k, name in enumerate(DECODERS)},
                samples,
                np.array([one.limit for one in by.values()]),
            ),
            f"After Fig. 6-12: mean over {draws} draws a point, ± its error. The source: within 10 % from 20 dB "
            "on, failing "
            "near 10 dB; its window over which the variance is taken is not printed.",
        )
        for truths, by in by_truths.items()
    ]
    cloud = PageFigure(
        "Where single draws end",
        cloud_figure(
            {name: {f"{snr} dB": one.found[k] for snr, one in clouds.items()} for k, name in enumerate(DECODERS)},
            TRUE,
        ),
        f"After Figs 6-10 and 6-11: {draws} draws of the noise on P = [20 14], for each decoder.",
    )
    return [
        Section(
            "Decoding: two pressures under noise",
            f"{draws} draws a cell, M = {samples} samples; Eq. 6.8 (squared: 0.1 is 32 % in relative L2), mean ± "
            "sd; paired: "
            "ours less the converged search, ± its standard error. Neither decoder is told which distribution it is; "
            "the limit is of a reader who is told, by Bayes.",
            ("truths", "SNR (dB)", *DECODERS, "paired", "ms, ours", "limit"),
            rows,
            (cloud, *figures),
        )
    ]


def _noise_row(truths: str, snr_db: int, one: NoisyDecoding) -> Row:
    apart = one.errors[2] - one.errors[1]
    return (
        truths,
        str(snr_db),
        *(f"{e.mean():.4f} ± {e.std(ddof=1):.4f}" for e in one.errors),
        f"{apart.mean():+.4f} ± {apart.std(ddof=1) / np.sqrt(len(apart)):.4f}",
        f"{one.ours_ms:.0f}",
        f"{one.limit:.4f}",
    )


def jobs(draws: int) -> list[tuple[str, int, int]]:
    """Arguments of every `noisy` that the sections want."""
    return [(truths, snr, draws) for truths in TRUTHS for snr in SNR_DB] + [("", snr, draws) for snr in CLOUD_SNR_DB]
