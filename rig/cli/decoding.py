"""What `rig decode` reads back, and by which decoder: receptors, their readings, what is known of their noise."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from rig.protocol.errors import BadInputError
from sim.coding.bayes import FittedReceptor, ModelError, Profile, decode_profile, decode_through
from sim.coding.encoding import QUIET_SD, Encoded, NoisePlace, Readings, Receptor, sd_at_rest
from sim.coding.operators import Operator, weighted
from sim.coding.search import Decoded, Range, converged_search, global_search, grid_search, table_search
from sim.coding.sheet import SheetOperator, decode_sheet

Array = NDArray[np.float64]

DecoderName = Literal["ours", "univariate", "grid", "table", "global"]
DECODERS: tuple[DecoderName, ...] = get_args(DecoderName)

TABLE_ENTRIES = 1000
SURPRISING = 5.0  # standard deviations of chi-squared beyond which readings are not explained
CUT_OFF = "the search was cut off before it stood still"
NO_NOISE = 1e-3
"""Of the highest reading: the sd that stands for no noise, since a likelihood needs one."""


@dataclass(frozen=True)
class Noisy:
    """What is known of the readings' noise, in their own unit."""

    sd: Array  # (m,)
    known: str  # how: told, measured at rest, assumed
    at: NoisePlace = "receptor"


@dataclass(frozen=True)
class Task:
    """Readings, SED where there is no receptor and rates where there is one, and what they are to be explained by."""

    operator: Operator
    reading: Array  # (m,)
    receptor: FittedReceptor | None
    noise: Noisy | None  # None: nothing is known of it
    true: Array | None = None  # (n,) pressures
    error: ModelError | None = None  # None: as meshes differ
    axial: str | None = None  # the shape along the finger under which a row is decoded, by name

    @property
    def sed(self) -> Array:
        """(m,) SED that the readings stand for; of a silent receptor its threshold."""
        receptor = None if self.receptor is None else self.receptor.receptor
        return self.reading if receptor is None else self.reading / receptor.gain + receptor.threshold

    @property
    def heard(self) -> NDArray[np.bool_]:
        """(m,) receptors whose reading is a number, not only a bound."""
        if self.receptor is None:
            return np.ones(len(self.reading), np.bool_)
        return self.reading > (QUIET_SD * self.noise.sd if self.noise and self.noise.at == "output" else 0)

    def unexplained(self, pressure: Array, share: float = 0.0) -> tuple[str, ...]:
        """A complaint where SED under (n,) pressures is farther from the readings than noise and a share of it."""
        if self.noise is None:
            return ()
        noise, sed = self.noise.sd / (1.0 if self.receptor is None else self.receptor.receptor.gain), self.sed
        off = (self.operator.sed(pressure) - sed) / np.hypot(noise, share * sed)
        expected, misfit = int(self.heard.sum()), float((off[self.heard] ** 2).sum())
        if misfit <= expected + SURPRISING * np.sqrt(2 * expected):
            return ()
        return (f"the readings are not explained: misfit {misfit:.3g}, expected about {expected}",)


class Search(NamedTuple):
    """How the decoders that search within a range do so; None: by the readings' size."""

    start: tuple[float, ...] | None = None
    within: tuple[float, float] | None = None
    grid_step: float | None = None
    seed: int = 0


@dataclass(frozen=True)
class Answer:
    """Pressures, how they were found, and what is to be said against them."""

    pressure: Array
    converged: bool
    ms: float
    profile: Profile | None = None  # of ours
    path: Array = field(default_factory=lambda: np.zeros((0, 0)))
    within: Range | None = None
    problems: tuple[str, ...] = ()


def noise_of(encoded: Encoded, receptor: Receptor | None, at: NoisePlace, seed: int) -> Noisy:
    """Measured, as it would be, from the same receptors at rest; where those are silent, told."""
    m = encoded.samples
    if not encoded.noise_sd:
        return Noisy(np.full(m, NO_NOISE * float(encoded.rate.max())), "assumed, there is none")
    if receptor is None:
        rest = encoded.noise_sd * np.random.default_rng((seed, 1)).normal(size=m)
        return Noisy(np.full(m, sd_at_rest(rest)), f"measured at rest of {m} receptors")
    unit = receptor.gain if at == "receptor" else 1.0
    return Noisy(np.full(m, unit * encoded.noise_sd), "told", at)


def decode(task: Task, decoder: DecoderName, search: Search) -> Answer:
    """Raises BadInputError for a start or a range that cannot be meant, DecodingError for such readings."""
    if not task.heard.any():
        raise BadInputError("no reading is above its noise: expected some that are", code="all_noise")
    if decoder == "ours":
        return _ours(task, search.seed)
    operator = task.operator.leaning(np.zeros(len(task.operator.place_mm)))  # upright: they know no other forces
    task = replace(task, operator=operator)
    within = _range(task, search)
    start = _start(task, search, within)
    step = (within.high - within.low) / 30 if search.grid_step is None else search.grid_step
    run: Mapping[str, Callable[[], Decoded]] = {
        "univariate": lambda: converged_search(operator, task.sed, start, within),
        "grid": lambda: grid_search(operator, task.sed, start, within, step),
        "table": lambda: table_search(operator, task.sed, within, TABLE_ENTRIES, search.seed),
        "global": lambda: global_search(operator, task.sed, within, search.seed),
    }
    began = time.perf_counter()
    found = run[decoder]()
    ms = 1e3 * (time.perf_counter() - began)
    ends = int(np.isclose(found.pressure, within.high, rtol=1e-9).sum())
    problems = [] if found.converged else [CUT_OFF]
    if ends:
        problems.append(f"{ends} of {len(found.pressure)} pressures stand at the end of the range, {within.high:g}")
    problems += task.unexplained(found.pressure)
    return Answer(found.pressure, found.converged, ms, None, found.path, within, tuple(problems))


def best_explained(tasks: Sequence[Task]) -> Task:
    """Of the same readings under several axial shapes: the one whose pressures explain them best, at a quick look."""
    return min(tasks, key=lambda task: _profile(task, _noise_of_ours(task), 0, table=False).misfit)


def _noise_of_ours(task: Task) -> Noisy:
    if task.noise is None:
        raise BadInputError(
            "--readings: expected a column sd or at_rest, decoder ours goes by the readings' noise",
            code="noise_unknown",
        )
    return task.noise


def _ours(task: Task, seed: int) -> Answer:
    noise = _noise_of_ours(task)
    began = time.perf_counter()
    profile = _profile(task, noise, seed)
    ms = 1e3 * (time.perf_counter() - began)
    share = (task.error or ModelError()).share
    problems = (() if profile.converged else (CUT_OFF,)) + task.unexplained(profile.pressure, share)
    return Answer(profile.pressure, profile.converged, ms, profile, problems=problems)


def _profile(task: Task, noise: Noisy, seed: int, *, table: bool = True) -> Profile:
    """Readings whose noise differs are weighted until it does not."""
    sd = float(np.median(noise.sd))
    weight = sd / noise.sd
    operator, reading = weighted(task.operator, weight), weight * task.reading

    def decoded(readings: Readings) -> Profile:
        if isinstance(operator, SheetOperator):
            return decode_sheet(operator, readings, operator.skin.grid.shape, task.error)
        return decode_profile(operator, readings, task.error, seed, table=table)

    def through(receptor: Receptor) -> Profile:
        of_rates = Readings.of_rates if noise.at == "receptor" else Readings.of_noisy_rates
        unit = receptor.gain if noise.at == "receptor" else 1.0
        mine = Receptor(receptor.gain, weight * receptor.threshold)
        return decoded(of_rates(reading, mine, sd / unit))

    if task.receptor is None:
        return decoded(Readings.of_sed(reading, sd))
    return decode_through(task.receptor, through)


def _range(task: Task, search: Search) -> Range:
    """By default from 0 to twice what the highest reading needs of the one pressure that it feels most."""
    if search.within is None:
        most = (task.operator.parts**2).sum(axis=0).max()
        return Range(0.0, 2 * float(np.sqrt(task.sed.max() / most)))
    return Range(*search.within)


def _start(task: Task, search: Search, within: Range) -> Array:
    """By default the even pressure that explains the readings best."""
    n = task.operator.parts.shape[2]
    if search.start is None:
        even = task.operator.sed(np.ones(n))
        size = np.sqrt(max(0.0, float(even @ task.sed)) / float(even @ even))
        return np.full(n, float(np.clip(size, *within)))
    given = np.array(search.start)
    if len(given) not in (1, n):
        raise BadInputError(
            "{option}: {numbers} numbers, expected 1 or {expected}",
            code="wrong_count", option="--start", numbers=len(given), expected=n,
        )  # fmt: skip
    if not ((given >= within.low) & (given <= within.high)).all():
        raise BadInputError(
            "{option}: expected numbers within --range {low:g} … {high:g}",
            code="outside_range", option="--start", low=within.low, high=within.high,
        )  # fmt: skip
    return np.full(n, given[0]) if len(given) == 1 else given
