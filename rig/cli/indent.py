"""`rig indent`: one simulated indentation."""

from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.table import Table

from rig.cli.output import ExitCode, complain, loading_the_finger, out, print_json, told_in_one_line
from rig.protocol.config import load_config
from rig.protocol.errors import BadInputError
from sim.contact.shapes import parse_shape
from sim.fingertip import Fingertip
from sim.measures.receptors import DEFAULT_DEPTH_MM
from sim.result import IndentationResult

_MODELS = ("finger", "section", "halfspace", "auto")


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("indent", help="One simulated indentation.")(command)


def command(
    shape: Annotated[str, typer.Option(metavar="S", help="bar:WIDTH, cylinder:DIAMETER, step:1|3|5")],
    x_mm: Annotated[float, typer.Option(metavar="X", help="Indentor's reference point from the pad's centre.")],
    doi_mm: Annotated[float | None, typer.Option(metavar="D", help="Depth past first contact.")] = None,
    force_gwt: Annotated[float | None, typer.Option(metavar="F", help="Force instead of a depth.")] = None,
    z_mm: Annotated[float | None, typer.Option(hidden=True)] = None,
    model: Annotated[str, typer.Option(metavar="M", help="finger")] = "finger",
    receptor_depth_mm: Annotated[float, typer.Option(metavar="D", help="Below the skin.")] = DEFAULT_DEPTH_MM,
    reference: Annotated[str, typer.Option(metavar="contact|apex", help="Where DOI is zero.")] = "contact",
    config: Annotated[Path | None, typer.Option(metavar="TOML", help="Configuration of the finger.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")] = False,
) -> None:
    """Press once and print force, contact and receptor measures."""
    with told_in_one_line(as_json=as_json):
        _refuse_model(model)
        if z_mm is not None:
            raise BadInputError("--z-mm: shapes placed by z (line) are not built yet")
        settings = load_config(config)
        profile = parse_shape(shape)
        if not 0.1 <= receptor_depth_mm <= 3.0:
            raise BadInputError(f"--receptor-depth-mm {receptor_depth_mm:g}: expected 0.1 … 3.0")
        with loading_the_finger():
            finger = Fingertip.load(settings.finger, receptor_depth_mm=receptor_depth_mm)
        result = finger.indent(profile, x_mm, doi_mm=doi_mm, force_gwt=force_gwt, reference=_reference(reference))
        if as_json:
            answer = result.as_json()
            answer["solver"]["build_s"] = finger.build_s
            print_json(answer)
        else:
            _print(result, finger.build_s)
        if not result.state.converged:
            complain(f"not converged, residual {result.state.residual:.1e}")
            raise typer.Exit(ExitCode.STOPPED)


def _refuse_model(model: str) -> None:
    if model not in _MODELS:
        raise BadInputError(f"--model {model!r}: expected one of {', '.join(_MODELS)}")
    if model != "finger":
        raise BadInputError(f"--model {model}: not built yet, expected finger")


def _reference(text: str) -> Literal["contact", "apex"]:
    if text not in ("contact", "apex"):
        raise BadInputError(f"--reference {text!r}: expected contact or apex")
    return "apex" if text == "apex" else "contact"


def _print(result: IndentationResult, build_s: float) -> None:
    state = result.state
    regions = ", ".join(f"[{a:.2f}, {b:.2f}]" for a, b in result.contact_regions_mm) or "none in the receptor plane"
    out.print(f"{result.profile.name} at x = {result.x_mm:g} mm")
    out.print(f"  force          {result.force_n:.5f} N = {result.force_gwt:.4f} gwt")
    out.print(f"  DOI            {result.doi_mm:.4f} mm")
    out.print(f"  peak pressure  {result.peak_pressure_pseudo:.0f} pseudo-units")
    out.print(f"  contact        {regions} mm")
    out.print(
        f"  solver         {state.passes} passes, residual {state.residual:.1e}, "
        f"{'converged' if state.converged else 'NOT converged'}; load {build_s:.2f} s, "
        f"contact {1e3 * result.contact_s:.0f} ms"
    )
    table = Table("receptor x (mm)", "ep1", "ep3", "s33 (pseudo)", "SED (pseudo)", box=None, padding=(0, 2))
    x = result.model.receptors.position_mm[:, 0]
    m = result.receptor_measures
    for k in range(len(x)):
        table.add_row(
            f"{x[k]:.2f}", f"{m['ep1'][k]:.4f}", f"{m['ep3'][k]:.4f}", f"{m['s33'][k]:.1f}", f"{m['sed'][k]:.3f}"
        )
    out.print(table)
