"""Chapter 6 among the source's figures and tables; docs/validation/coding.md has the rest."""

from functools import cache, partial

import numpy as np
from matplotlib.figure import Figure as Canvas
from numpy.typing import NDArray

from rig.report.coding_figures import DrawnImpulse, ErrorSurface, extents, impulse_figure, search_figure
from rig.report.page import PageFigure
from rig.report.style import BLUE, GREY, ORANGE, Plot
from sim.coding.all_sites import DRAWN, AllSites, Sampled, Where, kept_sites
from sim.coding.operators import ForwardOperator, ImpulseResponses, impulse_responses, shift_errors
from sim.coding.point_spread import mean_over
from sim.coding.search import Decoded, decoding_errors, error_surface
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
from studies.source.printed.entry import Claim, Entry
from studies.source.printed.rules import Above, Below, Near

Array = NDArray[np.float64]

PAGE = "docs/validation/coding.md"
TRUTHS = "U(0, 30)²"
_ACROSS = 81  # values of a surface's axis

# --- shift invariance ---


@once
def sites(answers: FingerAnswers) -> AllSites:
    """Under equal point loads; twenty seconds, or from the cache."""
    return kept_sites(answers.finger.config, Sampled()).sites


def exponent(answers: FingerAnswers, where: Where) -> float:
    """Mean m."""
    return mean_over(sites(answers).laws(where)).m


def exponents_spread(answers: FingerAnswers, where: Where) -> float:
    """Standard deviation of m over its mean."""
    return mean_over(sites(answers).laws(where)).m_spread


def sizes_spread(answers: FingerAnswers, where: Where) -> float:
    """Of A."""
    return mean_over(sites(answers).laws(where)).a_spread


def _site_10(answers: FingerAnswers, name: str) -> float:
    return float(getattr(sites(answers).sites[DRAWN].linear, name))


def _by_logarithms(answers: FingerAnswers, where: Where) -> str:
    return f"{mean_over(sites(answers).laws(where, 'logarithmic')).m:.2f} by logarithms"


def _site_figures(answers: FingerAnswers) -> tuple[PageFigure, ...]:
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
        axes.set(xlabel="site", ylabel=name, ylim=(0, None))
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


def at_rest(answers: FingerAnswers, k: int) -> float:
    """Amplitude at frequency 0 over the highest, of h, g or f."""
    amplitude = responses(answers).spectra()[1][k]
    return float(amplitude[0] / amplitude.max())


def _impulse_figures(answers: FingerAnswers) -> tuple[PageFigure, ...]:
    farthest = int(0.75 * HALF_LENGTH)
    drawn: dict[str, DrawnImpulse] = {
        axes: DrawnImpulse(impulse_responses(section), shift_errors(section, "finite", farthest))
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


def _ends(answers: FingerAnswers, decoder: str) -> str:
    first, second = search(answers)[decoder].pressure
    return f"ends at [{first:.2f} {second:.2f}]"


@once
def under_noise(_: FingerAnswers, snr_db: int) -> float:
    """Mean of Eq. 6.8 of the converged search."""
    told = (drawn(_operator(), TRUTHS, snr_db, SEED + k) for k in range(DRAWS))
    return float(np.mean([converged_error(_operator(), *one) for one in told]))


def _search_figures(answers: FingerAnswers) -> tuple[PageFigure, ...]:
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


def _noise(snr_db: int, source: str, rule: Above | Below) -> Claim:
    says = f"Eq. 6.8 of the search at {snr_db} dB, mean of {DRAWS} draws, truths from {TRUTHS}"
    return Claim(says, source, rule, partial(under_noise, snr_db=snr_db), "{:.3f}")


ENTRIES = (
    Entry(
        "6-3, 6-4, Table 6.1",
        "Shift invariance: strain energy under point loads at 24 sites falls off alike.",
        (
            Claim(
                "exponent m, mean of 18 sites on the pulp",
                "3.886",
                Near(3.886, 0.1, 0.25),
                partial(exponent, where="pulp"),
                beside=partial(_by_logarithms, where="pulp"),
            ),
            Claim(
                "its spread over them",
                "4.9 %",
                Near(0.049, 0.35, 0.7),
                partial(exponents_spread, where="pulp"),
                "{:.1%}",
            ),
            Claim(
                "spread of A over them",
                "10.2 %",
                Near(0.102, 0.35, 0.7),
                partial(sizes_spread, where="pulp"),
                "{:.1%}",
            ),
            Claim(
                "m, mean of all 24",
                "3.980",
                Near(3.980, 0.1, 0.25),
                partial(exponent, where="all"),
                beside=partial(_by_logarithms, where="all"),
            ),
            Claim("its spread", "6.2 %", Near(0.062, 0.35, 0.7), partial(exponents_spread, where="all"), "{:.1%}"),
            Claim("spread of A", "17.7 %", Near(0.177, 0.35, 0.7), partial(sizes_spread, where="all"), "{:.1%}"),
            Claim("m at site 10", "3.96", Near(3.96, 0.1, 0.25), partial(_site_10, name="m")),
            Claim(
                "R² there",
                "0.96 (called a correlation coefficient)",
                Near(0.96, 0.03, 0.1),
                partial(_site_10, name="r2"),
                "{:.3f}",
            ),
        ),
        figures=_site_figures,
        elsewhere=PAGE,
        reading="The source does not print its load, so A alone cannot be compared. Elements spread a force on "
        "one node, which lowers m. Only a depth counted vertically or loads along −y make A spread as "
        "widely (docs/validation/coding.md).",
    ),
    Entry(
        "ch. 6, impulse responses",
        "Impulse responses h, g and f and their spectra: h and g low-pass, nearly equal and opposite, f band-pass.",
        (
            Claim(
                "correlation of h and g",
                "nearly equal and opposite",
                Below(-0.95, -0.8),
                lambda answers: responses(answers).opposite.correlation,
                "{:.3f}",
            ),
            Claim(
                "h + g over h, relative L2",
                "nearly equal and opposite",
                Below(0.2, 0.5),
                lambda answers: responses(answers).opposite.relative_l2,
                "{:.0%}",
            ),
            *(
                Claim(
                    f"amplitude of {name} at frequency 0 over its highest",
                    "low-pass",
                    Above(0.7, 0.5),
                    partial(at_rest, k=k),
                )
                for k, name in enumerate("hg")
            ),
            Claim("the same of f", "band-pass", Below(0.3, 0.5), partial(at_rest, k=2)),
        ),
        figures=_impulse_figures,
        elsewhere=PAGE,
        reading="Axes are Cartesian, as in the source.",
    ),
    Entry(
        "6-6",
        "Encoding, a block diagram without numbers: from pressure to the receptors' readings, with noise.",
        elsewhere=PAGE,
    ),
    Entry(
        "6-8 … 6-12",
        "Decoding: the worked example, its search, and what noise does to it.",
        (
            Claim(
                "first pressure after the first move from [10 10]",
                "[24 10]",
                Near(24.0, 0.05, 0.15),
                first_move,
                "{:.1f}",
            ),
            Claim(
                "Eq. 6.8 at the end of the search, no noise",
                "reaches [20 14]",
                Below(1e-6, 1e-3),
                partial(ends_off, decoder=EXACT),
                "{:.0e}",
                partial(_ends, decoder=EXACT),
            ),
            Claim(
                "the same on a grid of 1",
                "sticks on a coarse grid",
                Above(1e-2, 1e-3),
                partial(ends_off, decoder=GRID),
                "{:.3f}",
                partial(_ends, decoder=GRID),
            ),
            _noise(20, "within 10 %", Below(0.1, 0.15)),
            _noise(10, "fails near 10 dB", Above(0.1, 0.07)),
        ),
        figures=_search_figures,
        elsewhere=PAGE,
        reading="Eq. 6.8 is squared: 10 % of it is 32 % in relative L2. The source does not print the window of "
        "its signal's variance; here it is all samples of the output.",
    ),
)
