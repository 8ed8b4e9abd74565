"""`rig indent`: simulate one indentation with the requested model."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, ClassVar, Literal, NotRequired, get_args

import numpy as np
import typer
from rich.table import Table

from rig.cli.options import (
    MOST_FRICTION,
    FingertipOption,
    JsonOption,
    bounded,
    checked_picture,
    numbers,
    option,
    write_picture,
)
from rig.cli.output import THE_FINGER, ExitCode, busy, complain, out, print_json, writes_json
from rig.cli.request import Excludes, Needs, Rule, takes
from rig.compare.recordings.deflection import DeflectionJson, compared_deflection, in_words, read_skin_deflection
from rig.errors import BadInputError
from rig.plan.config import load_config
from rig_shared.number_text import read_number
from rig_shared.outputs import Code, Output, Range
from rig_shared.plural import number_of
from sim.benchmark import QUANTITIES
from sim.cheapest_model import Aim, Choice, ChoiceJson, choose
from sim.config import FingertipConfig, MeshSpec
from sim.contact.indentor import ALONG, BOTH, Indentor
from sim.contact.patch import X, Z
from sim.contact.shapes import EXPECTED, parse_shape, with_size
from sim.measures.receptors import DEFAULT_DEPTH_MM, DEFAULT_X_MM, ReceptorPlaces
from sim.models.catalogue import MODELS, ModelName, load
from sim.models.fingertip import Fingertip
from sim.models.friction import FrictionResult
from sim.models.halfspace import modulus_of
from sim.models.pictures import ModelOutline, ReceptorsJson
from sim.models.result import (
    FrictionJson,
    IndentationResult,
    LoadingPathJson,
    PointLoadResult,
    PressureProfileJson,
    SolvedJson,
)
from sim.models.small_strain_error import SmallStrainJson
from sim.units import GWT_N

TOLERANCE, QUANTITY = "2%", "force"
"""Tolerance and quantity of `auto` by default."""

_LONGEST_MM = 50.0


class SolverJson(SolvedJson):
    """Model, its build time, and the solution of its contact."""

    build_s: float


class IndentJson(Output):
    """An indentation. A section without --length-mm has its force per mm only; a point load has no depth."""

    indentor_text: str
    force_n: float | None
    force_gwt: float | None
    force_n_per_mm: NotRequired[float]
    effective_length_mm: NotRequired[float | None]
    doi_mm: float | None
    peak_pressure_kpa: float | None
    small_strain: NotRequired[SmallStrainJson]
    path: NotRequired[LoadingPathJson]
    contact_regions_mm: list[Range]
    pressure: PressureProfileJson
    receptors: ReceptorsJson
    solver: SolverJson
    choice: ChoiceJson
    friction: NotRequired[FrictionJson]
    deflection: NotRequired[DeflectionJson]
    code: NotRequired[Code]


@dataclass(frozen=True)
class Chosen:
    """Model, chosen by name or automatically, and the length behind a section's force."""

    model: ModelName
    choice: Choice | None
    length_mm: float | None
    modulus: float | None = None
    """E / E(epidermis) of a half-space."""

    @property
    def why(self) -> str:
        """Reason for the choice of the model, in one line."""
        if self.choice is not None:
            return self.choice.why
        fitted = ", homogeneous" if self.modulus == 1 else ", fitted to the default finger"
        of = "" if self.modulus is None else f", E = {self.modulus:g} of the epidermis's{fitted}"
        return f"{self.model}, as requested{of}"

    @property
    def receptors(self) -> bool:
        """Whether the model has receptors."""
        return self.choice is None or self.choice.aim.receptors

    def load(self, config: FingertipConfig, slopes: tuple[int, ...], receptors: ReceptorPlaces) -> Fingertip:
        """Return the model of a configuration, for shapes that slope along some axes, with receptors."""
        if self.choice is None:
            return load(self.model, config, slopes=slopes, **receptors.as_options())
        return self.choice.load(config, receptors)

    def force_per_mm(self, force_gwt: float | None) -> float | None:
        """Return the force to request from the model; a section's is per millimeter."""
        if force_gwt is None or self.model != "section":
            return force_gwt
        if self.length_mm is None:
            raise BadInputError(
                "--force-gwt requires --length-mm with --model section, whose force is per millimeter; add it",
                "needs_option",
            )
        return force_gwt / self.length_mm

    def force_text(self, force_n: float) -> str:
        """Return the force as it is printed."""
        if self.model != "section":
            return f"{force_n:.5f} N = {force_n / GWT_N:.4f} gwt"
        if self.length_mm is None:
            return f"{force_n:.5f} N/mm (use --length-mm for the force in gwt)"
        whole = force_n * self.length_mm
        return f"{force_n:.5f} N/mm, over {self.length_mm:g} mm {whole:.5f} N = {whole / GWT_N:.4f} gwt"

    def described(self, result: IndentationResult | PointLoadResult, build_s: float) -> IndentJson:
        """Return the JSON of an indentation and its choice of model; a section's force is null without a length."""
        press, whole = result.as_json(), self.model != "section"
        named: ChoiceJson = {"level": None, "promised_error": None, "why_text": self.why}
        found: IndentJson = {
            "indentor_text": "point" if isinstance(result, PointLoadResult) else with_size(result.indentor.name),
            "force_n": press["force_n"] if whole else self._over_length(press["force_n"]),
            "force_gwt": press["force_gwt"] if whole else self._over_length(press["force_gwt"]),
            "doi_mm": press["doi_mm"],
            "peak_pressure_kpa": press["peak_pressure_kpa"],
            "contact_regions_mm": press["contact_regions_mm"],
            "pressure": press["pressure"],
            "receptors": press["receptors"],
            "solver": {**press["solver"], "build_s": build_s},
            "choice": named if self.choice is None else self.choice.as_json(),
        }
        if not whole:
            found["force_n_per_mm"], found["effective_length_mm"] = press["force_n"], self.length_mm
        if "small_strain" in press:
            found["small_strain"] = press["small_strain"]
        if "path" in press:
            found["path"] = press["path"]
        if "friction" in press:
            found["friction"] = press["friction"]
        return found

    def _over_length(self, force: float) -> float | None:
        return None if self.length_mm is None else force * self.length_mm


@dataclass(frozen=True)
class ModelRequest:
    """Model requested on the command line."""

    model: ModelName | None  # None: the cheapest that meets the tolerance
    aim: Aim
    length_mm: float | None

    @classmethod
    def parse(
        cls, model: str, tolerance: str | None, quantity: str | None, length_mm: float | None
    ) -> "ModelRequest":
        """Return the request; raise BadInputError with the allowed values."""
        if model not in (*MODELS, "auto"):
            raise BadInputError(
                f"--model {model!r}: must be one of {', '.join(get_args(ModelName))}, auto", "unknown_choice"
            )
        quantities = tuple((quantity or QUANTITY).split(","))
        if not set(quantities) <= set(QUANTITIES):
            raise BadInputError(
                f"--quantity {quantity!r}: must be one or more of {', '.join(QUANTITIES)}, separated by commas",
                "unknown_choice",
            )
        if length_mm is not None and not 0 < length_mm <= _LONGEST_MM:
            raise BadInputError(
                f"--length-mm {length_mm:g}: must be more than 0 and at most {_LONGEST_MM:g} mm", "outside_range"
            )
        aim = Aim(quantities, _fraction(tolerance or TOLERANCE), per_length=length_mm is not None)
        named = next((name for name in MODELS if name == model), None)
        return cls(named, aim, length_mm)

    def refuse(self, config: FingertipConfig, receptors: ReceptorPlaces) -> None:
        """Refuse options that a choice of model cannot use."""
        if self.model is not None:
            return
        if config.mesh != MeshSpec():
            raise BadInputError(
                "--model auto chooses the mesh itself; remove [finger.mesh] from the configuration or name a model",
                "mesh_configured",
            )
        if not self.aim.receptors and receptors != ReceptorPlaces():
            raise BadInputError(
                "--model auto computes no receptors for force alone; add --quantity sed or ep1", "receptors_unmade"
            )

    def named(self, config: FingertipConfig) -> Chosen | None:
        """Return the named model, or None if it is to be chosen."""
        if self.model is None:
            return None
        return Chosen(
            self.model, None, self.length_mm, modulus_of(config.tissue) if self.model == "halfspace" else None
        )

    def choose(self, press: "IndentRequest", indentor: Indentor, config: FingertipConfig) -> Chosen:
        """Return the cheapest model that meets the tolerance; raise NoModelError if none does."""
        found = choose(
            indentor,
            press.x_mm or 0.0,
            z_mm=press.z_mm,
            doi_mm=press.doi_mm,
            force_gwt=press.force_gwt,
            aim=self.aim,
            reference=press.reference,
            config=config,
        )
        return Chosen(found.model, found, self.length_mm)


def _fraction(text: str) -> float:
    try:
        value = read_number(text.removesuffix("%")) / (100 if text.endswith("%") else 1)
    except ValueError:
        value = -1.0
    if not 0 < value < 1:
        raise BadInputError(f"--tol {text!r}: must be a fraction between 0 and 1, e.g. 2% or 0.02", "bad_value")
    return value


_PRESS, _MODEL, _RECEPTORS, _OUTPUT = "Press", "Model", "Receptors", "Output"
_PLACED_MM = 1e-6
_SAME = 1e-8


@dataclass(frozen=True)
class IndentRequest:
    """Arguments and options of `rig indent`."""

    shape: Annotated[str, option(f"Indentor: {EXPECTED}; or point.", "S", _PRESS)]
    x_mm: Annotated[
        float | None, option("x of the indentor from the pad center, in mm. Default: 0.", "X", _PRESS)
    ] = None
    doi_mm: Annotated[
        float | None, option("Depth of indentation (DOI), in mm. Give this or --force-gwt.", "D", _PRESS)
    ] = None
    force_gwt: Annotated[
        float | None, option("Force to reach, in gwt (gram-weight). Give this or --doi-mm.", "F", _PRESS)
    ] = None
    z_mm: Annotated[
        float | None,
        option(
            "z along the finger, in mm, for line, round shapes and point. Default: the receptor plane.", "Z", _PRESS
        ),
    ] = None
    model: Annotated[str, option(f"Model: {', '.join(reversed(MODELS))} or auto.", "M", _MODEL)] = "finger"
    tolerance: Annotated[
        str | None,
        option(f"Relative error that auto allows, e.g. 0.02. Default: {TOLERANCE}.", "T", _MODEL, name="--tol"),
    ] = None
    quantity: Annotated[
        str | None,
        option(f"Quantities that auto holds to --tol: {', '.join(QUANTITIES)}. Default: {QUANTITY}.", "Q,Q…", _MODEL),
    ] = None
    length_mm: Annotated[
        float | None,
        option(
            "Length that multiplies the force per mm of a section, up to 50 mm. Default: force in N/mm.", "L", _MODEL
        ),
    ] = None
    receptor_x_mm: Annotated[
        str | None, option("Receptor x, in mm, also FROM:TO:STEP. Default: ten receptors.", "X,X…", _RECEPTORS)
    ] = None
    receptor_depth_mm: Annotated[
        str, option("Depths of the receptors below the skin, in mm.", "D,D…", _RECEPTORS)
    ] = f"{DEFAULT_DEPTH_MM:g}"
    receptor_z_mm: Annotated[
        str | None, option("Receptor z along the finger, in mm. Default: the receptor plane.", "Z,Z…", _RECEPTORS)
    ] = None
    reference: Annotated[
        Literal["contact", "apex"], option("Zero of DOI: first contact or the apex.", "contact|apex", _PRESS)
    ] = "contact"
    friction: Annotated[
        float,
        option("Friction coefficient. Default: 0.", "MU", _PRESS, within=(0, MOST_FRICTION), show_default=False),
    ] = 0.0
    config: FingertipOption = None
    picture: Annotated[Path | None, option("Plot the contact to a new .svg or .png file.", "FILE.svg", _OUTPUT)] = (
        None
    )
    deflection: Annotated[
        Path | None,
        option("Measured skin deflection to compare (deflection_mm with x_mm, z_mm or both).", "CSV", _OUTPUT),
    ] = None
    other_paths: Annotated[
        bool,
        option(
            "Press in smaller steps too, and report how much the forces differ.", panel=_OUTPUT, name="--other-paths"
        ),
    ] = False
    as_json: JsonOption = False

    rules: ClassVar[Sequence[Rule]] = (
        Needs("--tol", ("--model auto",)),
        Needs("--quantity", ("--model auto",)),
        Needs("--length-mm", ("--model section", "--model auto")),
        Excludes("--friction", ("--model auto", "--other-paths", "--shape point"), "friction_with"),
        Needs("--shape point", ("--model finger", "--model section"), "no_point_loads"),
        Excludes("--shape point", ("--doi-mm",), "point_load", "a point load has no depth"),
        Needs("--shape point", ("--force-gwt",), "point_load"),
        Excludes("--shape point", ("--picture",), "point_load", "a point load has no contact to plot"),
        Excludes("--shape point", ("--deflection",), "point_load", "a point load has no stored skin deflection"),
    )


@takes(IndentRequest)
def indent_command(request: IndentRequest) -> None:
    """Press once and print force, contact and receptor measures."""
    wanted = ModelRequest.parse(request.model, request.tolerance, request.quantity, request.length_mm)
    settings = load_config(request.config)
    receptors = _receptors(request)
    origin = request.reference
    checked_picture(request.picture)
    measured = None if request.deflection is None else read_skin_deflection(request.deflection)
    indentor = None if request.shape == "point" else parse_shape(request.shape)
    _refuse_place(request, indentor)
    if indentor is None:
        _load_a_point(request, wanted.named(settings.finger), settings.finger, receptors)
        return
    wanted.refuse(settings.finger, receptors)
    chosen = wanted.named(settings.finger) or wanted.choose(request, indentor, settings.finger)
    if chosen.choice is not None and not writes_json():
        out.print(f"auto chose {chosen.model}, level {chosen.choice.level}: {chosen.choice.outlook}")
    with busy(THE_FINGER, quick=True):
        finger = chosen.load(settings.finger, indentor.axes, receptors)
    force = chosen.force_per_mm(request.force_gwt)
    press = partial(
        finger.indent,
        indentor,
        request.x_mm or 0.0,
        z_mm=request.z_mm,
        reference=origin,
        other_paths=request.other_paths,
        friction=request.friction,
    )
    with busy(f"pressing {request.shape} …", quick=True):
        result = press(doi_mm=request.doi_mm, force_gwt=force)
    if request.picture is not None:
        with busy("drawing the figure …", quick=True):
            _draw(result, request.picture)
    beside = None if measured is None else compared_deflection(result, measured)
    if writes_json():
        answer = chosen.described(result, finger.build_s)
        if not result.state.converged:
            answer["code"] = "not_converged"
        if beside is not None:
            answer["deflection"] = beside
        print_json(answer)
    else:
        _print(result, chosen, finger.build_s)
        if beside is not None:
            out.print(f"  deflection     {in_words(beside)}")
    if not result.state.converged:
        complain(f"not converged, residual {result.state.residual:.1e}")
        raise typer.Exit(ExitCode.STOPPED)


def _load_a_point(
    request: IndentRequest, chosen: Chosen | None, config: FingertipConfig, receptors: ReceptorPlaces
) -> None:
    assert chosen is not None
    force = chosen.force_per_mm(request.force_gwt)
    assert force is not None
    with busy(THE_FINGER, quick=True):
        finger = chosen.load(config, ALONG, receptors)
    with busy("pressing a point …", quick=True):
        loaded = finger.point_load(request.x_mm or 0.0, force, z_mm=request.z_mm)
    _print_point_load(loaded, chosen, finger.build_s)


def _receptors(request: IndentRequest) -> ReceptorPlaces:
    x = DEFAULT_X_MM if request.receptor_x_mm is None else numbers("--receptor-x-mm", request.receptor_x_mm)
    depths = numbers("--receptor-depth-mm", request.receptor_depth_mm)
    for depth in depths:
        bounded("--receptor-depth-mm", depth, 0.1, 3.0)
    z_mm = None if request.receptor_z_mm is None else numbers("--receptor-z-mm", request.receptor_z_mm)
    return ReceptorPlaces(x, depths, z_mm)


def _refuse_place(request: IndentRequest, indentor: Indentor | None) -> None:
    shape, by = f"--shape {request.shape}", BOTH if indentor is None else indentor.placed_by
    if not by and not request.x_mm is request.z_mm is None:
        raise BadInputError(f"{shape} is the same everywhere; remove --x-mm and --z-mm", "no_place")
    if request.x_mm is not None and X not in by:
        raise BadInputError(f"{shape} lies across the finger; use --z-mm instead of --x-mm", "placed_by_z")
    if request.z_mm is not None and Z not in by:
        raise BadInputError(f"{shape} lies along the finger; use --x-mm instead of --z-mm", "placed_by_x")


def _draw(result: IndentationResult, picture: Path) -> None:
    from rig.report.run_figures import contacts_from_below  # matplotlib is slow to import

    title = f"{result.indentor.name} {result.force_gwt:.2f} gwt, DOI {result.doi_mm:.3f} mm"
    write_picture(contacts_from_below([result], [title]), picture)


def _print_point_load(result: PointLoadResult, chosen: Chosen, build_s: float) -> None:
    if writes_json():
        print_json(chosen.described(result, build_s))
        return
    if chosen.model == "section":
        out.print(f"line load of {chosen.force_text(result.force_n)} at x = {result.x_mm:g} mm of the section")
    else:
        out.print(f"point load of {result.force_gwt:.4f} gwt at x = {result.x_mm:g}, z = {result.z_mm:g} mm")
    _print_receptors(result)


def _print(result: IndentationResult, chosen: Chosen, build_s: float) -> None:
    state = result.state
    regions = ", ".join(f"[{a:.2f}, {b:.2f}]" for a, b in result.contact_regions_mm)
    at = {X: f"x = {result.x_mm:g}", Z: f"z = {result.z_mm:g}"}
    place = ", ".join(at[axis] for axis in result.indentor.placed_by)
    name = with_size(result.indentor.name)
    out.print(f"{name} at {place} mm" if place else name)
    out.print(f"  model          {chosen.why}")
    out.print(f"  force          {chosen.force_text(result.force_n)}")
    out.print(f"  DOI            {result.doi_mm:.4f} mm")
    out.print(f"  peak pressure  {result.peak_pressure_kpa:.3g} kPa")
    out.print(f"  contact        {f'{regions} mm' if regions else 'none in the receptor plane'}")
    out.print(f"  {result.small_strain.note}")
    if isinstance(result, FrictionResult):
        out.print(f"  friction       {_friction(result)}")
    if result.may_depend_on_path:
        out.print(f"  path           {_path(result, chosen)}")
    out.print(
        f"  solver         {state.passes} passes, residual {state.residual:.1e}, "
        f"{'converged' if state.converged else 'NOT converged'}; load {build_s:.2f} s, "
        f"contact {1e3 * result.contact_s:.0f} ms"
    )
    if chosen.receptors:
        _print_receptors(result)


def _friction(result: FrictionResult) -> str:
    """Return a note on how the skin sticks."""
    shear = " and ".join(f"{f:.5f}" for f in result.shear_force_n)
    return (
        f"{result.friction:g}, {number_of(result.increments, 'increments')}; sticking skin carries "
        f"{result.sticking_share:.0%} of the force; shear force {shear} N"
    )


def _path(result: IndentationResult, chosen: Chosen) -> str:
    """Return a note on how the force depends on the loading path."""
    if result.path_spread is None:
        return "the force may depend on the loading path; --other-paths reports by how much"
    if result.path_spread <= _SAME:
        return "finer increments give the same force"
    forces = " and ".join(chosen.force_text(force) for force in result.other_forces_n)
    return f"finer increments give {forces}: a spread of {result.path_spread:.2%}"


def _print_receptors(result: IndentationResult | PointLoadResult) -> None:
    places = _places(result.model)
    table = Table(*places, "ep1", "ep3", "s33 (pseudo)", "SED (pseudo)", box=None, padding=(0, 2))
    m = result.receptor_measures
    for k, place in enumerate(zip(*places.values(), strict=True)):
        at = (f"{v:z.2f}" for v in place)
        table.add_row(*at, f"{m['ep1'][k]:.4f}", f"{m['ep3'][k]:.4f}", f"{m['s33'][k]:.1f}", f"{m['sed'][k]:.3f}")
    out.print(table)


def _places(model: ModelOutline) -> dict[str, list[float]]:
    """Return the columns that distinguish receptors, by heading: x, and depth and z unless they are the default."""
    receptors = model.receptors
    x, _, z = receptors.position_mm.T
    found = {"receptor x (mm)": x.tolist()}
    if math.isnan(receptors.depth_mm):
        found["depth (mm)"] = receptors.depths_mm.tolist()
    if np.abs(z - model.plane_mm).max() > _PLACED_MM:
        found["z (mm)"] = z.tolist()
    return found
