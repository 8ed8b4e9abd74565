"""Afferents under the pad: end organs, sensitivities, conduction delays, and responses.

The words are those of TouchSim (Saal, Delhaye, Rayhaun and Bensmaia 2017, PNAS 114:E5693): `Stimulus`, `Afferent`,
`AfferentPopulation`, `Response`, `rate`, `psth`. Times are seconds here, and places are on the finger model.
"""

import math
import re
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rig_shared.number_text import read_number
from sim.errors import ModelRangeError
from sim.measures.receptors import tissue_below
from sim.models.fingertip import Fingertip
from sim.nerve.integrator import MOST_STEP_S
from sim.nerve.models import BUILT_IN, AfferentModel, spikes_of
from sim.nerve.skin import Signal, SkinUnderIndentor, table_of_presses
from sim.nerve.stimulus import Stimulus
from sim.tables import numbers_of

Array = NDArray[np.float64]
Models = Mapping[str, AfferentModel]

DENSITY_PER_CM2: Mapping[str, Mapping[str, float]] = {
    "monkey fingertip": {"SA1": 134, "RA": 178, "PC": 13},
    "monkey finger": {"SA1": 46, "RA": 80, "PC": 13},
    "human fingertip": {"SA1": 70, "RA": 140, "PC": 23},
    "human finger": {"SA1": 30, "RA": 40, "PC": 10},
    "human palm": {"SA1": 10, "RA": 25, "PC": 10},
}
"""Afferents per cm² of skin.

Monkey, distal pad and middle phalanx: Darian-Smith and Kenins (1980, J Physiol 309:147). Human: the table of
TouchSim; Johansson and Vallbo (1979, J Physiol 286:283) give 241 for all four classes at the tip, 58 in the palm.
"""

VELOCITY_M_S: Mapping[str, tuple[float, float, float, float]] = {
    "SA1": (59.0, 9.0, 36.0, 82.0),
    "RA": (55.3, 14.0, 26.0, 91.0),
    "PC": (46.9, 9.0, 34.0, 61.0),
}
"""Mean, standard deviation, lowest and highest conduction velocity (m/s).

RA and PC: Knibestöl (1973, J Physiol 232:427), whose ranges these are. SA-I: Knibestöl (1975), from memory. Standard
deviations are chosen so that the ranges hold most afferents.
"""
_OTHER_VELOCITY_M_S = (53.0, 8.0, 36.0, 73.0)

PATH_M = 0.2
"""Nerve between the fingertip and the electrode (m): from a monkey's fingertip to its forearm."""
AT_THE_RECEPTOR_S = (0.001, 0.002)
"""Range of the delay between the membrane of the receptor and its fiber (s)."""

SENSITIVITY_SPREAD: Mapping[str, float] = {"SA1": 3.0, "RA": 2.0, "PC": 3.0}
"""Factor by which the sensitivity of a class differs within one standard deviation; those with which the gains were
fitted."""
_OTHER_SPREAD = 3.0


def sensitivity_of(model: str, normal: ArrayLike, spread: float | None = None) -> Array:
    """Return sensitivities with median 1 at standard normal numbers, with the spread of a class or another."""
    spread = SENSITIVITY_SPREAD.get(model, _OTHER_SPREAD) if spread is None else spread
    return np.asarray(np.exp(math.log(spread) * numbers_of("normal", normal)))


PAD_SHARE = 0.7
"""Radius of the pad, as a share of the half-width of the finger at the receptor plane."""
SPACING_SHARE = 0.6
"""Least distance between afferents of one class, as a share of 1/√density."""
_MOST_TRIES = 2000
_BARE_MM = 0.25
"""Distance from a place without tissue within which no other is tried."""
MOST_AFFERENTS = 2000
"""Most afferents in one population."""


@dataclass(frozen=True)
class SimulatedAfferent:
    """One afferent with its end organs under the pad; numbers within its class are from 1.

    The center of its field is across the finger and along it from the receptor plane (mm), `organs_mm` from there.
    `sensitivity` is the factor of the receptor's signal; the delay is at the receptor.
    """

    model: str
    number: int
    x_mm: float
    along_mm: float
    sensitivity: float
    velocity_m_s: float
    receptor_delay_s: float
    seed: int
    organs_mm: tuple[tuple[float, float], ...] = ((0.0, 0.0),)

    @property
    def name(self) -> str:
        """Class and number, for example ``"SA1-2"``."""
        return f"{self.model}-{self.number}"

    def delay_s(self, path_m: float = PATH_M) -> float:
        """Return the time between a spike at the receptor and the same spike at the electrode (s)."""
        return path_m / self.velocity_m_s + self.receptor_delay_s


Afferent = SimulatedAfferent
"""TouchSim's name."""


@dataclass(frozen=True)
class PopulationResponse:
    """Spikes of a population at the electrode: ascending times (s) of each afferent within the covered time."""

    afferents: "AfferentPopulation"
    spikes: tuple[Array, ...]
    begins_s: float
    ends_s: float

    def rate(self, begins_s: float | None = None, ends_s: float | None = None) -> Array:
        """Return the mean rate of each afferent between two times (impulses/s). Default: the whole response."""
        begin, end = self._between(begins_s, ends_s)
        counts = [np.searchsorted(one, end) - np.searchsorted(one, begin) for one in self.spikes]
        return np.array(counts, dtype=float) / (end - begin)

    def psth(
        self, bin_s: float = 0.02, begins_s: float | None = None, ends_s: float | None = None
    ) -> tuple[Array, Array]:
        """Return a histogram of each afferent's spikes.

        Parameters
        ----------
        bin_s : float, optional
            Width of a bin (s).
        begins_s, ends_s : float, optional
            First and last edge (s). Default: those of the response.

        Returns
        -------
        edges_s : ndarray of shape (n_bins + 1,)
            Edges of the bins (s).
        rate : ndarray of shape (n_afferents, n_bins)
            Rates (impulses/s).
        """
        begin, end = self._between(begins_s, ends_s)
        bins = max(round((end - begin) / bin_s), 1)
        edges = np.linspace(begin, end, bins + 1)
        counts = np.array([np.histogram(one, edges)[0] for one in self.spikes], dtype=float)
        return edges, counts.reshape(len(self.spikes), bins) / np.diff(edges)

    def only(self, model: str) -> "Response":
        """Return the response of one class."""
        kept = [k for k, one in enumerate(self.afferents) if one.model == model]
        return Response(
            AfferentPopulation([self.afferents[k] for k in kept]),
            tuple(self.spikes[k] for k in kept),
            self.begins_s,
            self.ends_s,
        )

    def _between(self, begins_s: float | None, ends_s: float | None) -> tuple[float, float]:
        begin = self.begins_s if begins_s is None else begins_s
        end = self.ends_s if ends_s is None else ends_s
        if not begin < end:
            raise ModelRangeError(f"from {begin:g} to {end:g} s: the end must come after the beginning", "no_window")
        return begin, end


Response = PopulationResponse
"""TouchSim's name."""


class AfferentPopulation(Sequence[Afferent]):
    """Afferents of a finger.

    Parameters
    ----------
    afferents : sequence of Afferent
        The afferents.
    models : mapping of str to AfferentModel, optional
        Classes by name. Default: SA1, RA and PC.
    """

    def __init__(self, afferents: Sequence[Afferent], models: Models = BUILT_IN) -> None:
        self._afferents, self.models = tuple(afferents), models

    @overload
    def __getitem__(self, k: int) -> Afferent: ...

    @overload
    def __getitem__(self, k: slice) -> "AfferentPopulation": ...

    def __getitem__(self, k: int | slice) -> "Afferent | AfferentPopulation":
        """Return one afferent, or a part of the population."""
        if isinstance(k, slice):
            return AfferentPopulation(self._afferents[k], self.models)
        return self._afferents[k]

    def __len__(self) -> int:
        """Return the number of afferents."""
        return len(self._afferents)

    def __repr__(self) -> str:
        counts = {name: sum(one.model == name for one in self) for name in dict.fromkeys(one.model for one in self)}
        return f"<AfferentPopulation of {', '.join(f'{n} {name}' for name, n in counts.items()) or 'nothing'}>"

    @cached_property
    def groups(self) -> dict[str, list[int]]:
        """Indices of the afferents of each class."""
        names = dict.fromkeys(one.model for one in self)
        return {name: [k for k, one in enumerate(self) if one.model == name] for name in names}

    @cached_property
    def organs(self) -> tuple[NDArray[np.intp], ...]:
        """Indices of the end organs of each afferent among those of all."""
        ends = np.cumsum([0, *(len(one.organs_mm) for one in self)])
        return tuple(np.arange(begin, end) for begin, end in pairwise(ends))

    def organs_of(self, afferents: Sequence[int]) -> NDArray[np.intp]:
        """Return the indices of the end organs of some afferents, (n, n_organs).

        Those of an afferent that has fewer than another are repeated, which leaves the strongest as it is.
        """
        most = max(len(self.organs[k]) for k in afferents)
        return np.array([np.resize(self.organs[k], most) for k in afferents])

    def points_mm(self, finger: Fingertip) -> Array:
        """Return the end organs of all afferents in a finger, (n_organs of all, 3) in mm."""
        found = np.empty((sum(map(len, self.organs)), 3))
        for name, afferents in self.groups.items():
            x_mm, along_mm = np.array(
                [
                    (self[k].x_mm + x_mm, self[k].along_mm + along_mm)
                    for k in afferents
                    for x_mm, along_mm in self[k].organs_mm
                ]
            ).T
            depth_mm, z_mm = self.models[name].depth_mm, finger.config.receptor_plane_mm + along_mm
            points = tissue_below(finger.config, finger.surface, x_mm, depth_mm, z_mm)
            for k in np.flatnonzero(np.isnan(points[:, 0])):
                points[k] = finger.points_below(x_mm[k], depth_mm, z_mm[k])  # raises the error
            found[np.concatenate([self.organs[k] for k in afferents])] = points
        return found

    def measure(self, measures: dict[str, Array]) -> Array:
        """Return each end organ's measure, (n_organs of all,), from the 18 measures at all of them."""
        found = np.empty(sum(map(len, self.organs)))
        for name, afferents in self.groups.items():
            mine = np.concatenate([self.organs[k] for k in afferents])
            found[mine] = self.models[name].measure({key: values[mine] for key, values in measures.items()})
        return found

    def pressed(
        self,
        finger: Fingertip,
        indentor: str,
        deepest_mm: float,
        x_mm: float = 0.0,
        z_mm: float | None = None,
    ) -> SkinUnderIndentor:
        """Return the signals at all end organs, in order of the afferents, while an indentor moves over one place."""
        points = self.points_mm(finger)
        presses = table_of_presses(finger, indentor, deepest_mm, x_mm, z_mm)
        return SkinUnderIndentor(finger, "", points, self.measure, deepest_mm, presses=presses)

    def spikes(self, signal: Signal) -> list[Array]:
        """Return each afferent's spike times at its receptor (s); signals are in the order of `points_mm`."""
        found: list[Array] = [np.empty(0)] * len(self)
        for name, mine in self.groups.items():
            part = Signal(signal.step_s, signal.value[self.organs_of(mine)])
            sensitivity = [self[k].sensitivity for k in mine]
            own = spikes_of(self.models[name], part, sensitivity, [self[k].seed for k in mine])
            for k, one in zip(mine, own, strict=True):
                found[k] = one
        return found

    def response(
        self,
        finger: Fingertip,
        indentor: str,
        stimulus: Stimulus,
        *,
        x_mm: float = 0.0,
        z_mm: float | None = None,
        path_m: float = PATH_M,
    ) -> Response:
        """Return the response to a stimulus at one place.

        Parameters
        ----------
        finger : Fingertip
            The finger.
        indentor : str
            The shape, for example ``"bar:3.0"``.
        stimulus : Stimulus
            Depth against time.
        x_mm, z_mm : float, optional
            Place of the indentor (mm).
        path_m : float, optional
            Nerve between the fingertip and the electrode (m).

        Returns
        -------
        Response
            Spike times at the electrode, on the clock of the stimulus.

        Examples
        --------
        >>> from sim import load
        >>> from sim.nerve.population import draw
        >>> from sim.nerve.stimulus import Stimulus
        >>> finger = load("halfspace")
        >>> population = draw(finger, "2xSA1@0:0")
        >>> found = population.response(finger, "cylinder:9", Stimulus.ramp(0.1, 1.0, 0.5))
        >>> len(found.spikes)
        2
        """
        skin = self.pressed(finger, indentor, stimulus.deepest_mm, x_mm, z_mm)
        found = self.spikes(skin.signal(stimulus, MOST_STEP_S))
        late = [one + afferent.delay_s(path_m) for one, afferent in zip(found, self, strict=True)]
        return Response(
            self, tuple(late), 0.0, stimulus.ends_s + max((one.delay_s(path_m) for one in self), default=0)
        )


# --- drawing ---


@dataclass(frozen=True)
class Pad:
    """Part of the skin with end organs: an ellipse about the middle of the receptor plane."""

    half_x_mm: float
    half_along_mm: float

    @classmethod
    def of(cls, finger: Fingertip) -> "Pad":
        """Return the pad of a finger."""
        plane = finger.config.receptor_plane_mm
        across = np.abs(finger.surface.section(np.linspace(0.0, np.pi, 181), plane)[0]).max()
        half = PAD_SHARE * float(across)
        ends = min(plane, finger.config.geometry.length_mm - plane)
        return cls(half, min(half, PAD_SHARE * ends))

    @property
    def area_cm2(self) -> float:
        """Area (cm²)."""
        return math.pi * self.half_x_mm * self.half_along_mm / 100

    def has(self, x_mm: float, along_mm: float) -> bool:
        """Return whether a place lies on the pad."""
        return (x_mm / self.half_x_mm) ** 2 + (along_mm / self.half_along_mm) ** 2 <= 1 + 1e-9


@dataclass(frozen=True)
class AfferentRequest:
    """Requested afferents of one class; without a location they are placed at random over the pad."""

    model: str
    count: int
    place_mm: tuple[float, float] | None = None


_ITEM = re.compile(r"(?:(\d+)x)?([^@\s]+?)(?:@([^:]+)(?::(.+))?)?", re.ASCII)


def parse_afferents(text: str, models: Models = BUILT_IN) -> tuple[AfferentRequest, ...]:
    """Parse a request for afferents, items separated by commas.

    ``3xSA1`` draws three places, ``SA1@0.5:1`` is one at x = 0.5 mm, 1 mm along the finger from the receptor plane.
    Raises ModelRangeError if an item cannot be read, its class is unknown, or there are too many.
    """
    found = []
    for item in text.split(","):
        match = _ITEM.fullmatch(item.strip()) if len(item) < 100 else None
        place = None if match is None else _place(match[3], match[4])
        if match is None or (place is not None and not all(map(math.isfinite, place))):
            raise ModelRangeError(
                f"{item.strip()[:100]!r}: must be afferents such as 3xSA1, or one at a place, SA1@X or "
                "SA1@X:ALONG in mm",
                "bad_afferents",
            )
        if match[2] not in models:
            raise ModelRangeError(
                f"{match[2]!r}: there is no such class of afferents; use {', '.join(models)}", "unknown_afferent"
            )
        found.append(AfferentRequest(match[2], int(match[1] or 1), place))
    total = sum(one.count for one in found)
    if not 0 < total <= MOST_AFFERENTS or any(one.count == 0 for one in found):
        raise ModelRangeError(f"{total} afferents: must be 1 to {MOST_AFFERENTS}", "number_of_afferents")
    return tuple(found)


def _place(x: str | None, along: str | None) -> tuple[float, float] | None:
    if x is None:
        return None
    try:
        return read_number(x), read_number(along or "0")
    except ValueError:
        return math.nan, math.nan


def draw(
    finger: Fingertip,
    afferents: str | Sequence[AfferentRequest],
    seed: int = 0,
    *,
    density: str = "monkey fingertip",
    models: Models = BUILT_IN,
) -> AfferentPopulation:
    """Return afferents at places on the pad, with sensitivities and delays.

    An afferent depends on the seed, its class and its number only, not on the others that are asked for.

    Parameters
    ----------
    finger : Fingertip
        The finger.
    afferents : str or sequence of AfferentRequest
        What to draw, for example ``"3xSA1,5xRA"``.
    seed : int, optional
        Seed.
    density : str, optional
        Key of `DENSITY_PER_CM2`; it sets the least distance between afferents of a class.
    models : mapping of str to AfferentModel, optional
        Classes by name.

    Returns
    -------
    AfferentPopulation
        The afferents, in the order in which they were asked for.

    Raises
    ------
    ModelRangeError
        If the text cannot be used, a place lies off the pad, or the pad has no room for so many.
    """
    asked = parse_afferents(afferents, models) if isinstance(afferents, str) else tuple(afferents)
    pad = Pad.of(finger)
    found: list[Afferent] = []
    drawn: dict[str, Iterator[tuple[float, float]]] = {}
    numbers: dict[str, int] = {}
    for one in asked:
        if one.place_mm is not None and not (
            pad.has(*one.place_mm) and _has_tissue(finger, models[one.model])(*one.place_mm).all()
        ):
            raise ModelRangeError(
                f"{one.model} at x = {one.place_mm[0]:g} mm, {one.place_mm[1]:g} mm along the finger: lies off "
                f"the pad, which reaches {pad.half_x_mm:.2f} mm across and {pad.half_along_mm:.2f} mm along the "
                "finger",
                "afferent_off_pad",
            )
        for _ in range(one.count):
            if one.place_mm is None and one.model not in drawn:
                spacing = _spacing_mm(density, one.model)
                tissue = _has_tissue(finger, models[one.model])
                drawn[one.model] = _places(pad, spacing, _generator(seed, one.model, 0), tissue)
            place = next(drawn[one.model], None) if one.place_mm is None else one.place_mm
            if place is None:
                raise ModelRangeError(
                    f"{one.model}: the pad has no room for {one.count} afferents at least "
                    f"{_spacing_mm(density, one.model):.2f} mm apart",
                    "no_room",
                )
            numbers[one.model] = numbers.get(one.model, 0) + 1
            found.append(_afferent(finger, models[one.model], one.model, numbers[one.model], place, seed))
    return AfferentPopulation(found, models)


def population(finger: Fingertip, density: str = "monkey fingertip", seed: int = 0) -> AfferentPopulation:
    """Return all afferents of the pad at a published density.

    Parameters
    ----------
    finger : Fingertip
        The finger.
    density : str, optional
        Key of `DENSITY_PER_CM2`.
    seed : int, optional
        Seed.

    Returns
    -------
    AfferentPopulation
        SA1, RA and PC.

    Raises
    ------
    ModelRangeError
        If there is no such density.
    """
    area = Pad.of(finger).area_cm2
    return draw(
        finger,
        [AfferentRequest(name, max(round(area * per_cm2), 1)) for name, per_cm2 in _densities(density).items()],
        seed,
        density=density,
    )


def _densities(density: str) -> Mapping[str, float]:
    if density not in DENSITY_PER_CM2:
        raise ModelRangeError(f"{density!r}: must be one of {', '.join(DENSITY_PER_CM2)}", "unknown_density")
    return DENSITY_PER_CM2[density]


def _spacing_mm(density: str, model: str) -> float:
    known = _densities(density)
    return SPACING_SHARE * 10 / math.sqrt(known.get(model, max(known.values())))


def _generator(seed: int, model: str, number: int) -> np.random.Generator:
    return np.random.default_rng([seed, zlib.crc32(model.encode()), number])


def _has_tissue(finger: Fingertip, model: AfferentModel) -> Callable[[ArrayLike, ArrayLike], NDArray[np.bool_]]:
    """Return whether there is tissue at a class's depth below each place, shape (n_places,)."""

    def has(x_mm: ArrayLike, along_mm: ArrayLike) -> NDArray[np.bool_]:
        z_mm = finger.config.receptor_plane_mm + np.asarray(along_mm, dtype=float)
        points = tissue_below(finger.config, finger.surface, x_mm, model.depth_mm, z_mm)
        return np.asarray(np.isfinite(points[:, 0]))

    return has


def _places(
    pad: Pad,
    spacing_mm: float,
    generator: np.random.Generator,
    has_tissue: Callable[[float, float], NDArray[np.bool_]],
) -> Iterator[tuple[float, float]]:
    """Yield places on the pad, even but for a least distance, until there seems to be no room."""
    found, bare = np.empty((0, 2)), np.empty((0, 2))
    tries = 0
    while tries < _MOST_TRIES:
        tries += 1
        at = generator.uniform(-1.0, 1.0, 2) * (pad.half_x_mm, pad.half_along_mm)
        x_mm, along_mm = (round(float(mm), 3) for mm in at)
        if not pad.has(x_mm, along_mm) or _near(found, at, spacing_mm) or _near(bare, at, _BARE_MM):
            continue
        if has_tissue(x_mm, along_mm).all():
            found, tries = np.vstack([found, [x_mm, along_mm]]), 0
            yield x_mm, along_mm
        else:
            bare = np.vstack([bare, at])


def _near(places: Array, at: Array, distance_mm: float) -> bool:
    return len(places) > 0 and bool(np.hypot(*(places - at).T).min() < distance_mm)


def draw_organs(
    model: AfferentModel,
    generator: np.random.Generator,
    has_tissue: Callable[[Array, Array], NDArray[np.bool_]] | None = None,
) -> tuple[tuple[float, float], ...]:
    """Return the places (mm) of an afferent's end organs from its center, across the finger and along it.

    They are even in a disc, a single one at the center; where `has_tissue` is false they are drawn again.
    """
    if model.organs == 1:
        return ((0.0, 0.0),)

    def places(count: int) -> Array:
        radius, turn = generator.uniform(size=(count, 2)).T
        turn = 2 * np.pi * turn
        return np.round(0.5 * model.field_mm * np.sqrt(radius) * (np.cos(turn), np.sin(turn)), 3).T

    found = places(model.organs)
    if has_tissue is not None:
        while not (there := has_tissue(*found.T)).all():
            found[~there] = places(int((~there).sum()))
    return tuple((float(x_mm), float(along_mm)) for x_mm, along_mm in found)


def _afferent(
    finger: Fingertip, model: AfferentModel, name: str, number: int, place_mm: tuple[float, float], seed: int
) -> Afferent:
    generator = _generator(seed, name, number)
    mean, sd, lowest, highest = VELOCITY_M_S.get(name, _OTHER_VELOCITY_M_S)
    velocity = lowest - 1.0
    while not lowest <= velocity <= highest:
        velocity = float(generator.normal(mean, sd))
    has_tissue = _has_tissue(finger, model)
    return Afferent(
        name,
        number,
        *place_mm,
        sensitivity=float(sensitivity_of(name, generator.standard_normal())),
        velocity_m_s=velocity,
        receptor_delay_s=float(generator.uniform(*AT_THE_RECEPTOR_S)),
        seed=int(generator.integers(2**63)),
        organs_mm=draw_organs(
            model, generator, lambda x_mm, along_mm: has_tissue(place_mm[0] + x_mm, place_mm[1] + along_mm)
        ),
    )
