"""The cheapest model, level of mesh, patch and outputs that hold a tolerance, by errors and costs as measured.

It hangs on the scene and the tolerance alone, not on what happens to be in the cache: the same call gives the same
answer tomorrow.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from sim.config.fingertip_config import FingertipConfig, MeshSpec
from sim.contact.indentor import BOTH, Indentor
from sim.contact.shapes import parse_shape
from sim.measures.reach import NOWHERE, ReceptorPlaces
from sim.models.catalogue import ModelName, load
from sim.models.errors import ModelRangeError, refuse_unless_one
from sim.models.fingertip import Fingertip
from sim.speed_and_error.candidates import of_level
from sim.speed_and_error.expected import DEPTHS_MM, PLACES_MM, Cost, Expected, Rung, bundled
from sim.speed_and_error.measure import QUANTITIES
from sim.speed_and_error.situation import Situation

AT_RECEPTORS = frozenset({"sed", "ep1"})
"""Quantities for which receptors are made."""


class NoModelError(ModelRangeError):
    """No model is known to hold the tolerance."""

    default_code = "no_model"


@dataclass(frozen=True)
class Aim:
    """What is asked for, and how right it shall be: each of the quantities, relative."""

    quantities: tuple[str, ...] = ("force",)
    tolerance: float = 0.02
    per_length: bool = False  # whether a force per length, a section's, is of use

    def __post_init__(self) -> None:
        if not self.quantities or not set(self.quantities) <= set(QUANTITIES):
            raise ModelRangeError(
                "{quantities}: expected some of {known}",
                code="unknown_quantity",
                quantities=", ".join(self.quantities),
                known=", ".join(QUANTITIES),
            )
        if not 0 < self.tolerance < 1:
            raise ModelRangeError(
                "tolerance {tolerance:g}: expected a part of the whole, between 0 and 1",
                code="bad_tolerance",
                tolerance=self.tolerance,
            )

    @property
    def receptors(self) -> bool:
        """Whether any are needed."""
        return bool(AT_RECEPTORS & set(self.quantities))

    @property
    def text(self) -> str:
        """As it is said."""
        return f"{100 * self.tolerance:g} % of {', '.join(self.quantities)}"


@dataclass(frozen=True)
class Choice:
    """A model, the level of its mesh, its patch and outputs; what it promises and what it costs."""

    model: ModelName
    level: str
    mesh: MeshSpec
    axes: tuple[int, ...]  # along which the shape slopes
    sharp: bool
    aim: Aim
    errors: Mapping[str, float]  # the largest measured in scenes of this kind, relative, by quantity
    cost: Cost
    passed: tuple[str, ...]  # cheaper ones, and what they may be off by

    @property
    def promised(self) -> float:
        """The largest error of what was asked for."""
        return max(self.errors.values())

    @property
    def seconds(self) -> float:
        """Of processor time, from nothing to the answer."""
        return _seconds(self.cost, self.aim)

    @property
    def patch_mm(self) -> tuple[float, float]:
        """Half-widths of the skin that may be touched, before it has to grow."""
        mesh = self.mesh
        return (mesh.round_patch_mm,) * 2 if self.axes == BOTH else (mesh.patch_x_mm, mesh.patch_z_mm)

    @property
    def why(self) -> str:
        """In one line."""
        kind = "sharp" if self.sharp else "smooth"
        errors = ", ".join(map(_percent, self.errors.values()))
        passed = f"; cheaper ones passed over: {'; '.join(self.passed)}" if self.passed else ""
        return (
            f"{self.model}, level {self.level}: the largest error of {', '.join(self.errors)} measured under {kind} "
            f"shapes, so deep and so placed, is {errors}, the tolerance {100 * self.aim.tolerance:g} %{passed}"
        )

    @property
    def outlook(self) -> str:
        """What is made and what it costs, in one line, before anything is solved."""
        x, z = self.patch_mm
        outputs = "force, contact and receptors" if self.aim.receptors else "force and contact, no receptors"
        return (
            f"{outputs}; patch ± {x:.2f} × ± {z:.2f} mm; from nothing some {_short(self.seconds)} s of processor "
            f"time and {_short(self.cost.memory_mb / 1e3)} GB, a further press {_short(1e3 * self.cost.press_s)} ms"
        )

    def load(self, config: FingertipConfig | None = None, places: ReceptorPlaces | None = None) -> Fingertip:
        """The model of a finger, with receptors at places (default: the ten) where they were asked for.

        Raises ModelRangeError for a finger with a mesh of its own.
        """
        config = FingertipConfig() if config is None else config
        if config.mesh != MeshSpec():
            raise ModelRangeError(
                "the mesh is chosen: expected a finger without one of its own ([finger.mesh])", code="own_mesh"
            )
        wanted = (places or ReceptorPlaces()) if self.aim.receptors else NOWHERE
        config = config.model_copy(update={"mesh": self.mesh})
        return load(self.model, config, slopes=self.axes, **wanted.as_options())

    def as_json(self) -> dict[str, Any]:
        """What `rig indent --json` prints under `choice`."""
        x, z = self.patch_mm
        return {
            "level": self.level,
            "promised_error": self.promised,
            "why": self.why,
            "tolerance": self.aim.tolerance,
            "outputs": ["force", "contact", *(["receptors"] if self.aim.receptors else [])],
            "mesh": self.mesh.model_dump(mode="json", exclude_defaults=True),
            "patch_mm": [x, z],
            "expected_error": dict(self.errors),
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
    """The cheapest that is known to hold an aim (default: 2 % of the force) in a scene; nothing is solved.

    Errors were measured on the default finger, against the level `fine`. Raises NoModelError with the best there is.
    """
    refuse_unless_one(doi_mm, force_gwt)
    shape = parse_shape(indentor) if isinstance(indentor, str) else indentor
    situation = Situation.of(shape, x_mm, z_mm, doi_mm, config or FingertipConfig(), reference)
    return cheapest(situation, aim or Aim(), bundled())


def cheapest(situation: Situation, aim: Aim, expected: Expected) -> Choice:
    """The first, from cheap to dear, whose largest error holds; raises NoModelError with the best there is."""
    known = expected.errors(situation)
    errors = {rung: of for rung, of in known.items() if _of_use(rung, of, situation, aim)}
    if not errors:
        raise _unknown(situation)
    worst = {rung: max(of[quantity] for quantity in aim.quantities) for rung, of in errors.items()}
    ranked = sorted(errors, key=lambda rung: _seconds(expected.cost(rung, situation), aim))
    passed: list[str] = []
    for rung in ranked:
        if worst[rung] <= aim.tolerance:
            held = {quantity: errors[rung][quantity] for quantity in aim.quantities}
            mesh = of_level(*rung, situation.axes, expected.share(rung, situation)).mesh
            cost = expected.cost(rung, situation)
            return Choice(*rung, mesh, situation.axes, situation.sharp, aim, held, cost, tuple(passed))
        passed.append(f"{rung.model} {rung.level} {_percent(worst[rung])}")
    best = min(ranked, key=lambda rung: worst[rung])
    raise NoModelError(
        "no model is known to hold {aim} for {shape}: the best is {model}, level {level}, expected "
        "{expected_percent:g} %",
        aim=aim.text,
        shape=situation.shape,
        model=best.model,
        level=best.level,
        expected_percent=_two_digits(100 * worst[best]),
    )


def _of_use(rung: Rung, errors: Mapping[str, float], situation: Situation, aim: Aim) -> bool:
    """Whether all that is asked for was measured. A section, whose force is per length, is of use by depth."""
    of_use = rung.model != "section" or (aim.per_length and situation.depth_mm is not None)
    return of_use and set(aim.quantities) <= set(errors)


def _seconds(cost: Cost, aim: Aim) -> float:
    return cost.build_s + cost.press_s + (cost.receptors_s if aim.receptors else 0.0)


def _unknown(situation: Situation) -> NoModelError:
    depth = "by force" if situation.depth_mm is None else "{depth_mm:.2f} mm deep"
    return NoModelError(
        f"no model's error is known for {{shape}} {depth}, {{place_mm:.2f}} mm from the pad's centre: measured to "
        "{deepest_mm:g} and {farthest_mm:g} mm, expected --model finger",
        code="not_measured",
        shape=situation.shape,
        depth_mm=situation.depth_mm,
        place_mm=situation.place_mm,
        deepest_mm=DEPTHS_MM[-1],
        farthest_mm=PLACES_MM[-1],
    )


def _percent(error: float) -> str:
    return f"{_short(100 * error)} %"


def _short(value: float) -> str:
    return f"{_two_digits(value):g}"


def _two_digits(value: float) -> float:
    """Rounded; below a million it is written without an exponent."""
    return float(f"{value:.2g}")
