"""Choice of the cheapest model, mesh level, patch and outputs within a tolerance, from measured errors and costs.

The choice depends on the scene and the tolerance alone, not on the state of the cache, so that it is reproducible.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any, Literal, NamedTuple, NotRequired, cast

import numpy as np
from numpy.typing import NDArray

from rig_shared.outputs import Output, Range, Ratio, Settings
from sim.benchmark import QUANTITIES, SHARES, Level, of_level
from sim.config import FingertipConfig, Geometry, MeshSpec, finger_config
from sim.contact.first_contact import FirstTouch, first_touch
from sim.contact.indentor import ACROSS, ALONG, BOTH, Indentor
from sim.contact.patch import X, Z
from sim.contact.shapes import parse_shape
from sim.errors import ModelRangeError, refuse_unless_numbers, refuse_unless_one
from sim.finger.surface import FingertipSurface
from sim.measures.receptors import NOWHERE, ReceptorPlaces
from sim.models.cache import keep_tops
from sim.models.catalogue import ModelName, load
from sim.models.default_finger import is_default_finger
from sim.models.fingertip import Fingertip
from sim.models.pressing import refuse_beside_the_finger, refuse_meaningless

# --- situation ---
#
# A situation determines a model's error and the size of its patch, without solving.

Array = NDArray[np.float64]

_AXES = {ALONG: "along", ACROSS: "across", BOTH: "both"}
_GRID_MM = 0.1
_TOUCHED = 0.9  # contact width / width over which the indentor lies below the undeformed skin
_MARGIN_MM = (0.3, 0.5)  # one and a half rows of nodes, across and along


class ExpectedErrorsJson(Output):
    """Largest measured relative error of each requested quantity."""

    force: NotRequired[Ratio]
    width: NotRequired[Ratio]
    sed: NotRequired[Ratio]
    ep1: NotRequired[Ratio]


class ExpectedCostJson(Output):
    """Measured cost."""

    from_nothing_s: float
    press_s: float
    memory_mb: float


class ChoiceJson(Output):
    """Choice of the model; a model named on the command line has only the first three keys."""

    level: Level | None
    promised_error: Ratio | None
    why_text: str
    tolerance: NotRequired[Ratio]
    outputs: NotRequired[list[Literal["force", "contact", "receptors"]]]
    mesh: NotRequired[Settings]
    """Table [finger.mesh] of the configuration."""
    patch_mm: NotRequired[Range]
    expected_error: NotRequired[ExpectedErrorsJson]
    expected_cost: NotRequired[ExpectedCostJson]


def family_of(indentor: Indentor) -> str:
    """Return the family of shapes that an indentor is measured with."""
    return _family(indentor.axes, sharp=indentor.sharp)


def _family(axes: tuple[int, ...], *, sharp: bool) -> str:
    return f"{_AXES[axes]}, {'sharp' if sharp else 'smooth'}"


FAMILIES = tuple(_family(axes, sharp=sharp) for axes in _AXES for sharp in (False, True))


@dataclass(frozen=True)
class Situation:
    """Shape over a position, and its depth."""

    shape: str
    axes: tuple[int, ...]
    sharp: bool
    place_mm: float  # distance of first touch from the pad's center
    depth_mm: float | None  # past first touch; None for a force
    reach_mm: tuple[float, float] | None  # half-widths of the skin that may be touched; None without a depth

    @classmethod
    def of(
        cls,
        indentor: Indentor,
        x_mm: float,
        z_mm: float | None,
        doi_mm: float | None,
        config: FingertipConfig,
        reference: Literal["contact", "apex"] = "contact",
    ) -> "Situation":
        """Return the situation from the undeformed skin alone. Raises ModelRangeError for a position out of range."""
        refuse_beside_the_finger(config, x_mm, z_mm)
        refuse_meaningless(indentor, x_mm, z_mm)
        skin = _skin(config.geometry)
        centre = np.array([0.0, config.receptor_plane_mm])
        at = {X: x_mm, Z: centre[1] if z_mm is None else z_mm}
        reference_mm = tuple(float(at[axis]) for axis in indentor.axes)
        touch = first_touch(indentor, reference_mm, skin)
        middle = [{X: 0.0, Z: centre[1]}[axis] for axis in indentor.axes]
        zero_mm = touch.height_mm
        if reference == "apex":
            zero_mm = float(np.nanmax(skin.ridge(skin.ridge.x)))
        depth = None if doi_mm is None else doi_mm - (zero_mm - touch.height_mm)
        reach = None if depth is None else _reach(indentor, reference_mm, touch, depth, skin, centre)
        away = float(np.hypot.reduce(np.array(touch.at_mm) - middle))
        return cls(indentor.name, indentor.axes, indentor.sharp, away, depth, reach)

    @property
    def family(self) -> str:
        """Family of shapes that represents it."""
        return _family(self.axes, sharp=self.sharp)

    @property
    def share(self) -> float:
        """Smallest of SHARES whose patch holds the skin that may be touched; the largest for an unknown depth."""
        if self.reach_mm is None:
            return SHARES[-1]
        own = MeshSpec()
        sides = (own.round_patch_mm,) * 2 if self.axes == BOTH else (own.patch_x_mm, own.patch_z_mm)
        needed = max(reach / side for reach, side in zip(self.reach_mm, sides, strict=True))
        return next((share for share in SHARES if needed <= share), SHARES[-1])


@lru_cache(maxsize=2)
def _skin(geometry: Geometry) -> FingertipSurface:
    skin = FingertipSurface.fit(geometry)
    keep_tops(skin)
    return skin


def _reach(
    indentor: Indentor,
    reference_mm: tuple[float, ...],
    touch: FirstTouch,
    depth_mm: float,
    skin: FingertipSurface,
    centre: Array,
) -> tuple[float, float]:
    """Return how far from the pad's center, along x and z, the indentor may touch (mm)."""
    (x0, x1), (z0, z1) = skin.ridge.x[[0, -1]], skin.crest.x[[0, -1]]
    x, z = np.meshgrid(np.arange(x0, x1, _GRID_MM), np.arange(z0, z1, _GRID_MM))
    where = np.stack([x.ravel(), z.ravel()])
    offset = np.stack([{X: where[0], Z: where[1]}[axis] for axis in indentor.axes]) - np.array(reference_mm)[:, None]
    below = indentor.evaluate(offset).height_mm + touch.height_mm - depth_mm < skin.height(*where)
    if not below.any():
        return 0.0, 0.0
    far = _TOUCHED * np.abs(where[:, below] - centre[:, None]).max(axis=1) + _MARGIN_MM
    return float(far[0]), float(far[1])


# --- expected errors ---
#
# `python -m studies.choice.table` measures errors and costs by family of shapes, depth and position.

FILE = "expected_errors.json"

DEPTHS_MM = (0.3, 0.7, 1.35)
PLACES_MM = (0.5, 1.8)
"""Upper ends of the bands of depth, and of the distance of first contact from the pad center (mm)."""


class Cell(NamedTuple):
    """Scenes with similar errors: a family, up to a depth, up to a distance from the center."""

    family: str
    depth_mm: float
    place_mm: float


class Rung(NamedTuple):
    """Model with the level of its mesh."""

    model: ModelName
    level: str


class Cost(NamedTuple):
    """Cost of a press from nothing: processor seconds of one thread, and the memory of the build."""

    build_s: float  # without receptors
    receptors_s: float  # for ten of them
    press_s: float
    memory_mb: float


def cell_of(situation: Situation) -> Cell | None:
    """Return the cell of a scene of known depth; None where nothing was measured."""
    cells = cells_of(situation)
    return cells[0] if situation.depth_mm is not None and cells else None


def cells_of(situation: Situation) -> list[Cell]:
    """Return the cells of a scene, at every depth if its own is not known; none where nothing was measured."""
    band_mm = next((band for band in PLACES_MM if situation.place_mm <= band), None)
    if band_mm is None:
        return []
    if situation.depth_mm is None:
        return [Cell(situation.family, depth, band_mm) for depth in DEPTHS_MM]
    if not situation.depth_mm > 0:
        return []
    return [Cell(situation.family, depth, band_mm) for depth in DEPTHS_MM if situation.depth_mm <= depth][:1]


@dataclass(frozen=True)
class Expected:
    """Largest errors in each cell, by rung and quantity, and the cost of each rung on a share of the patch."""

    largest: Mapping[Cell, Mapping[Rung, Mapping[str, float]]]
    costs: Mapping[tuple[Rung, tuple[int, ...], float, bool], Cost]  # by axes of slope, share, sharp

    def errors(self, situation: Situation) -> dict[Rung, dict[str, float]]:
        """Return the largest errors of the rungs that were measured in every cell of the scene."""
        cells = [self.largest.get(cell, {}) for cell in cells_of(situation)]
        if not cells:
            return {}
        shared = set.intersection(*(set(cell) for cell in cells))
        return {
            rung: {quantity: max(cell[rung][quantity] for cell in cells) for quantity in cells[0][rung]}
            for rung in sorted(shared)
        }

    def share(self, rung: Rung, situation: Situation) -> float:
        """Return the smallest share of the patch that is large enough and whose cost is known."""
        known = (s for s in SHARES if (rung, situation.axes, s, situation.sharp) in self.costs)
        return next(share for share in known if share >= situation.share)

    def cost(self, rung: Rung, situation: Situation) -> Cost:
        """Return the cost of one press."""
        return self.costs[rung, situation.axes, self.share(rung, situation), situation.sharp]


@cache
def bundled() -> Expected:
    """Return the measured errors and costs."""
    return from_json((files("sim") / "data" / FILE).read_text(encoding="utf-8"))


def from_json(text: str) -> Expected:
    """Read the table that `studies/choice/table.py` writes."""
    content = json.loads(text)
    largest = {
        Cell(row["family"], row["depth_mm"], row["place_mm"]): {
            Rung(one["model"], one["level"]): dict(one["errors"]) for one in row["largest"]
        }
        for row in content["errors"]
    }
    return Expected(largest, {key: cost for row in content["costs"] for key, cost in _costs(row)})


def _costs(row: Mapping[str, Any]) -> Iterator[tuple[tuple[Rung, tuple[int, ...], float, bool], Cost]]:
    for sharp, press_s in ((False, row["smooth_press_s"]), (True, row["sharp_press_s"])):
        key = Rung(row["model"], row["level"]), tuple(row["axes"]), row["share"], sharp
        yield key, Cost(row["build_s"] - row["receptors_s"], row["receptors_s"], press_s, row["memory_mb"])


AT_RECEPTORS = frozenset({"sed", "ep1"})
"""Quantities that require receptors."""


class NoModelError(ModelRangeError):
    """Error for a tolerance that no model is known to meet."""

    default_code = "no_model"


@dataclass(frozen=True)
class Aim:
    """Quantities that a model must compute, and their tolerance.

    Parameters
    ----------
    quantities : tuple of str, optional
        Some of ``"force"``, ``"width"``, ``"sed"``, ``"ep1"``.
    tolerance : float, optional
        Largest relative error of each quantity, between 0 and 1.
    per_length : bool, optional
        Whether the force per length of a section is acceptable.

    Examples
    --------
    >>> from sim import Aim
    >>> Aim(("force", "sed"), 0.05).text
    '5 % of force, sed'
    """

    quantities: tuple[str, ...] = ("force",)
    tolerance: float = 0.02
    per_length: bool = False

    def __post_init__(self) -> None:
        quantities: object = self.quantities
        if isinstance(quantities, str):
            object.__setattr__(self, "quantities", (quantities,))
        if not self.quantities or not set(self.quantities) <= set(QUANTITIES):
            raise ModelRangeError(
                f"{', '.join(self.quantities)}: must be one or more of {', '.join(QUANTITIES)}", "unknown_quantity"
            )
        refuse_unless_numbers(tolerance=self.tolerance)
        if not 0 < self.tolerance < 1:
            raise ModelRangeError(
                f"tolerance {self.tolerance:g}: must be a fraction between 0 and 1", "bad_tolerance"
            )

    @property
    def receptors(self) -> bool:
        """Whether a quantity needs receptors."""
        return bool(AT_RECEPTORS & set(self.quantities))

    @property
    def text(self) -> str:
        """The aim in words, for example ``"2 % of force"``."""
        return f"{100 * self.tolerance:g} % of {', '.join(self.quantities)}"


@dataclass(frozen=True)
class Choice:
    """Model with its mesh, patch and outputs, its expected errors and its cost.

    Attributes
    ----------
    model : {'halfspace', 'section', 'finger'}
        The model.
    level : str
        Level of its mesh.
    mesh : MeshSpec
        Mesh, with the size of the patch.
    axes : tuple of int
        Axes along which the shape slopes.
    sharp : bool
        Whether the shape has an edge.
    aim : Aim
        What was requested.
    errors : mapping of str to float
        Largest relative error measured in scenes of this kind, by quantity.
    cost : Cost
        Processor time (s) and memory (MB) of a press.
    passed : tuple of str
        Cheaper models, and their errors.
    measured : bool
        Whether the errors were measured on this finger, the default one.

    Examples
    --------
    >>> from sim import choose
    >>> choice = choose("cylinder:9", doi_mm=0.2)
    >>> choice.promised <= choice.aim.tolerance
    True
    """

    model: ModelName
    level: str
    mesh: MeshSpec
    axes: tuple[int, ...]
    sharp: bool
    aim: Aim
    errors: Mapping[str, float]
    cost: Cost
    passed: tuple[str, ...]
    measured: bool = True

    @property
    def promised(self) -> float:
        """Largest expected relative error of a requested quantity."""
        return max(self.errors.values())

    @property
    def seconds(self) -> float:
        """Processor time from nothing to the answer (s)."""
        return _seconds(self.cost, self.aim)

    @property
    def patch_mm(self) -> tuple[float, float]:
        """Half-widths across and along the finger of the patch that an indentor may touch (mm)."""
        mesh = self.mesh
        return (mesh.round_patch_mm,) * 2 if self.axes == BOTH else (mesh.patch_x_mm, mesh.patch_z_mm)

    @property
    def why(self) -> str:
        """Reason for the choice, in one line."""
        kind = "sharp" if self.sharp else "smooth"
        errors = ", ".join(map(_percent, self.errors.values()))
        of = "" if self.measured else " of the default finger, since this one was not measured"
        passed = f"; cheaper models rejected: {'; '.join(self.passed)}" if self.passed else ""
        return (
            f"{self.model}, level {self.level}: the largest measured error of {', '.join(self.errors)} under "
            f"{kind} shapes at this depth and position is {errors}{of}; the tolerance is "
            f"{100 * self.aim.tolerance:g} %{passed}"
        )

    @property
    def outlook(self) -> str:
        """Outputs and cost, in one line, before anything is solved."""
        x, z = self.patch_mm
        outputs = "force, contact and receptors" if self.aim.receptors else "force and contact, no receptors"
        return (
            f"{outputs}; patch ± {x:.2f} × ± {z:.2f} mm; about {_short(self.seconds)} s of processor time and "
            f"{_short(self.cost.memory_mb / 1e3)} GB without cached models, {_short(1e3 * self.cost.press_s)} "
            "ms for each further press"
        )

    def load(self, config: FingertipConfig | None = None, places: ReceptorPlaces | None = None) -> Fingertip:
        """Load the chosen model of a finger, with receptors where the aim needs them.

        Parameters
        ----------
        config : FingertipConfig, optional
            A finger without a mesh of its own. Default: the default finger.
        places : ReceptorPlaces, optional
            Positions of the receptors. Default: the ten of Raju (1998, ch. 5).

        Returns
        -------
        Fingertip
            The model.

        Raises
        ------
        ModelRangeError
            If the finger has a mesh of its own.
        """
        config = finger_config(config)
        if config.mesh != MeshSpec():
            raise ModelRangeError(
                "the choice sets the mesh itself; remove [finger.mesh] from the configuration", "own_mesh"
            )
        locations = (places or ReceptorPlaces()) if self.aim.receptors else NOWHERE
        config = config.model_copy(update={"mesh": self.mesh})
        return load(self.model, config, slopes=self.axes, **locations.as_options())

    def as_json(self) -> ChoiceJson:
        """Return the object `choice` of `rig indent --json`.

        Returns
        -------
        dict
            Numbers, lists and text; names carry their units.
        """
        x, z = self.patch_mm
        return {
            "level": self.level,
            "promised_error": self.promised,
            "why_text": self.why,
            "tolerance": self.aim.tolerance,
            "outputs": ["force", "contact", "receptors"] if self.aim.receptors else ["force", "contact"],
            "mesh": self.mesh.model_dump(mode="json", exclude_defaults=True),
            "patch_mm": (x, z),
            "expected_error": cast(ExpectedErrorsJson, dict(self.errors)),
            "expected_cost": {
                "from_nothing_s": self.seconds,
                "press_s": self.cost.press_s,
                "memory_mb": self.cost.memory_mb,
            },
        }


def choose(
    indentor: Indentor | str,
    x_mm: float = 0.0,
    *,
    z_mm: float | None = None,
    doi_mm: float | None = None,
    force_gwt: float | None = None,
    aim: Aim | None = None,
    reference: Literal["contact", "apex"] = "contact",
    config: FingertipConfig | None = None,
) -> Choice:
    """Choose the cheapest model that is known to hold an aim in a scene; nothing is solved.

    The errors were measured on the default finger, against the level `fine`. For another finger only the levels of
    `finger` are considered, since the errors of half-space and section are those of its layers and shape. The choice
    depends on the finger, the scene and the aim, not on the cache.

    Parameters
    ----------
    indentor : Indentor or str
        The shape, for example ``"bar:3.0"``.
    x_mm : float, optional
        Lateral position of its reference point (mm).
    z_mm : float, optional
        Position along the finger (mm). Default: the receptor plane.
    doi_mm : float, optional
        Depth of indentation (mm). Pass either a depth or a force.
    force_gwt : float, optional
        Force (gwt).
    aim : Aim, optional
        Default: 2 % of the force.
    reference : {'contact', 'apex'}, optional
        As in `Fingertip.indent`.
    config : FingertipConfig, optional
        Default: the default finger.

    Returns
    -------
    Choice
        Model, mesh, patch and outputs.

    Raises
    ------
    NoModelError
        If no model holds the aim; the message has the best one.
    ModelRangeError
        If there is not exactly one of depth and force, or the position has no meaning for the shape.
    ShapeError
        If there is no such indentor.

    Examples
    --------
    >>> from sim import Aim, choose
    >>> choose("bar:3.0", doi_mm=0.5, aim=Aim(("force", "sed"), 0.05)).model
    'finger'
    """
    refuse_unless_one(doi_mm, force_gwt)
    shape = parse_shape(indentor) if isinstance(indentor, str) else indentor
    finger = finger_config(config)
    situation = Situation.of(shape, x_mm, z_mm, doi_mm, finger, reference)
    measured = is_default_finger(finger) and finger.contact.between_nodes
    return cheapest(situation, aim or Aim(), bundled(), measured=measured)


def cheapest(situation: Situation, aim: Aim, expected: Expected, *, measured: bool = True) -> Choice:
    """Return the first, from cheap to dear, whose largest error holds. Raises NoModelError with the best one.

    Errors not `measured` on this finger count for the levels of the finger only.
    """
    known = expected.errors(situation)
    errors = {
        rung: of
        for rung, of in known.items()
        if _of_use(rung, of, situation, aim) and (measured or rung.model == "finger")
    }
    if not errors:
        raise _unknown(situation)
    worst = {rung: max(of[quantity] for quantity in aim.quantities) for rung, of in errors.items()}
    ranked = sorted(errors, key=lambda rung: _seconds(expected.cost(rung, situation), aim))
    passed: list[str] = []
    for rung in ranked:
        if worst[rung] <= aim.tolerance:
            held = {quantity: errors[rung][quantity] for quantity in aim.quantities}
            mesh = of_level(*rung, expected.share(rung, situation)).mesh
            cost = expected.cost(rung, situation)
            return Choice(*rung, mesh, situation.axes, situation.sharp, aim, held, cost, tuple(passed), measured)
        passed.append(f"{rung.model} {rung.level} {_percent(worst[rung])}")
    best = min(ranked, key=lambda rung: worst[rung])
    raise NoModelError(
        f"no model is known to reach {aim.text} for {situation.shape}; the best is {best.model}, level "
        f"{best.level}, with {_two_digits(100 * worst[best]):g} %; allow a larger error or name a model",
    )


def _of_use(rung: Rung, errors: Mapping[str, float], situation: Situation, aim: Aim) -> bool:
    """Return whether all requested quantities were measured. A section, whose force is per length, needs a depth."""
    applies = rung.model != "section" or (aim.per_length and situation.depth_mm is not None)
    return applies and set(aim.quantities) <= set(errors)


def _seconds(cost: Cost, aim: Aim) -> float:
    return cost.build_s + cost.press_s + (cost.receptors_s if aim.receptors else 0.0)


def _unknown(situation: Situation) -> NoModelError:
    depth = "to a force" if situation.depth_mm is None else f"{situation.depth_mm:.2f} mm deep"
    return NoModelError(
        f"the errors for {situation.shape} {depth}, {situation.place_mm:.2f} mm from the pad center, were not "
        f"measured; measured are depths to {DEPTHS_MM[-1]:g} mm and distances to {PLACES_MM[-1]:g} mm; name a model, "
        "e.g. --model finger",
        "not_measured",
    )


def _percent(error: float) -> str:
    return f"{_short(100 * error)} %"


def _short(value: float) -> str:
    return f"{_two_digits(value):g}"


def _two_digits(value: float) -> float:
    """Round to two digits; below a million this prints without an exponent."""
    return float(f"{value:.2g}")
