"""Chapter 6 among the source's figures and tables; docs/validation/coding.md has the rest."""

from functools import cache

import numpy as np
from matplotlib.figure import Figure as Canvas
from numpy.typing import NDArray

from rig.report.coding_figures import ErrorSurface, ImpulsePlot, extents, impulse_figure, search_figure
from rig.report.page_parts import PageFigure
from rig.report.style import BLUE, GREY, ORANGE, Plot
from sim.coding.decoder_results import Decoded, decoding_errors
from sim.coding.decoders_by_search import error_surface
from sim.coding.operators import ForwardOperator, ImpulseResponses, impulse_responses, shift_errors
from sim.coding.point_spread import mean_over
from sim.coding.raju_table_6_1 import DRAWN, AllSites, Sampled, Where, cached_sites
from sim.coding.section import AXES, HALF_LENGTH, Axes, SampledSection, Sampling, sampled_section
from studies.coding.two_samples import (
    DRAWS,
    RANGE,
    SEED,
    TRUE,
    converged_error,
    drawn,
    sampled_operator,
    worked_example,
)
from studies.source.printed.answers import FingerAnswers, once

Array = NDArray[np.float64]

TRUTHS = "U(0, 30)²"
_ACROSS = 81  # values of a surface's axis

# --- shift invariance ---


@once
def sites(answers: FingerAnswers) -> AllSites:
    """Under equal point loads; twenty seconds, or from the cache."""
    return cached_sites(answers.finger.config, Sampled()).sites


def exponent(answers: FingerAnswers, where: Where) -> float:
    """Mean m."""
    return mean_over(sites(answers).laws(where)).m


def exponents_spread(answers: FingerAnswers, where: Where) -> float:
    """Standard deviation of m over its mean."""
    return mean_over(sites(answers).laws(where)).m_spread


def sizes_spread(answers: FingerAnswers, where: Where) -> float:
    """Of A."""
    return mean_over(sites(answers).laws(where)).a_spread


def site_10(answers: FingerAnswers, name: str) -> float:
    """A number of the site that the source draws."""
    return float(getattr(sites(answers).sites[DRAWN].linear, name))


def by_logarithms(answers: FingerAnswers, where: Where) -> str:
    """m of the other fit, in words."""
    return f"{mean_over(sites(answers).laws(where, 'logarithmic')).m:.2f} by logarithms"


def site_figures(answers: FingerAnswers) -> tuple[PageFigure, ...]:
    """The power law at all sites."""
    caption = (
        "m and A of every site, ours (blue) beside the printed ones (orange); A multiplied by one factor, which "
        "makes its mean over the pulp the printed one. Sites beyond the line are on the tip."
    )
    plot = Plot((10.2, 3.2), lambda canvas: _draw_sites(canvas, sites(answers)))
    return (PageFigure("The power law at 24 sites", plot, caption),)


def _draw_sites(canvas: Canvas, found: AllSites) -> None:
    numbers = [row.number for row in found.printed]
    factor, on_pulp = found.common_factor, sum(site.spread.site.on_pulp for site in found.sites)
    ours = [site.linear for site in found.sites]
    columns = (
        ("m", [one.m for one in ours], [row.m for row in found.printed]),
        ("A", [factor * one.a for one in ours], [row.a for row in found.printed]),
    )
    for axes, (name, mine, printed) in zip(canvas.subplots(1, 2), columns, strict=True):
        axes.plot(numbers, mine, "o", ms=4, color=BLUE, label="here")
        axes.plot(numbers, printed, "s", ms=4, mfc="none", color=ORANGE, label="Table 6.1")
        axes.axvline(on_pulp + 0.5, color=GREY, lw=0.6, ls=":")
        axes.set(xlabel="site (1)", ylabel=name, ylim=(0, None))
        axes.legend(fontsize=8)


# --- impulse responses ---


@once
def sections(answers: FingerAnswers) -> dict[Axes, SampledSection]:
    """In both kinds of axes."""
    return {axes: sampled_section(answers.finger.config, Sampling(axes=axes)) for axes in AXES}


@once
def responses(answers: FingerAnswers) -> ImpulseResponses:
    """h, g and f in the source's axes."""
    return impulse_responses(sections(answers)["cartesian"])


def opposite(answers: FingerAnswers, name: str) -> float:
    """How nearly h and −g are the same."""
    return float(getattr(responses(answers).opposite, name))


def at_rest(answers: FingerAnswers, k: int) -> float:
    """Amplitude at frequency 0 over the highest, of h, g or f."""
    amplitude = responses(answers).spectra()[1][k]
    return float(amplitude[0] / amplitude.max())


def impulse_figures(answers: FingerAnswers) -> tuple[PageFigure, ...]:
    """Responses and their spectra."""
    farthest = int(0.75 * HALF_LENGTH)
    drawn: dict[str, ImpulsePlot] = {
        axes: ImpulsePlot(impulse_responses(section), shift_errors(section, "finite", farthest))
        for axes, section in sections(answers).items()
    }
    caption = "After Fig. 6-5. Left: in the skin's axes; right: Cartesian, as the source."
    return (PageFigure("h, g, f, their spectra, and what shifting them misses", impulse_figure(drawn), caption),)


# --- decoding ---


EXACT, GRID = "univariate, converged", "univariate, grid of 1"


@once
def search(_: FingerAnswers) -> dict[str, Decoded]:
    """The worked example, on the default finger's section."""
    return worked_example(_operator())


@cache
def _operator() -> ForwardOperator:
    return sampled_operator()


def first_move(answers: FingerAnswers) -> float:
    """The first pressure after it."""
    return float(search(answers)[EXACT].path[1][0])


def ends_off(answers: FingerAnswers, decoder: str) -> float:
    """Eq. 6.8 where a search ends."""
    return decoding_errors(TRUE, search(answers)[decoder].pressure).eq_6_8


def ends_said(answers: FingerAnswers, decoder: str) -> str:
    """Where a search ends, in words."""
    first, second = search(answers)[decoder].pressure
    return f"ends at [{first:.2f} {second:.2f}]"


@once
def under_noise(_: FingerAnswers, snr_db: int) -> float:
    """Mean of Eq. 6.8 of the converged search."""
    told = (drawn(_operator(), TRUTHS, snr_db, SEED + k) for k in range(DRAWS))
    return float(np.mean([converged_error(_operator(), *one) for one in told]))


def search_figures(answers: FingerAnswers) -> tuple[PageFigure, ...]:
    """The error surface and the searches on it."""
    found = search(answers)
    ends = {"the whole range": (np.zeros(2), np.full(2, RANGE.high)), **extents(found[EXACT].path)}
    surfaces = {title: _surface(low, high) for title, (low, high) in ends.items()}
    paths = {"exact along each coordinate": found[EXACT].path, "grid of 1": found[GRID].path}
    caption = (
        "After Figs 6-8 and 6-9. Grey: decades of the squared error. White dot: start; square: end; star: truth."
    )
    return (PageFigure("The error surface and the ways over it", search_figure(surfaces, paths, TRUE), caption),)


def _surface(low: Array, high: Array) -> ErrorSurface:
    first, second = (np.linspace(a, b, _ACROSS) for a, b in zip(np.maximum(low, 0.0), high, strict=True))
    return ErrorSurface(first, second, error_surface(_operator(), _operator().sed(TRUE), first, second))
