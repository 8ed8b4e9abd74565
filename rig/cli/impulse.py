"""`rig impulse`: what a point load on the finger's section does to the receptors under it."""

from pathlib import Path
from typing import Any

from rich.table import Table

from rig.cli.options import FingertipOption, JsonOption
from rig.cli.output import busy, out, print_json, told_in_one_line
from rig.cli.pictures import PictureOption, checked_picture, write_picture
from rig.cli.sampling import DepthOption, EnergyOption, HalfLengthOption, SpacingOption, named, sampling_of
from rig.plan.config import load_config
from sim.coding.operators import NAMES, ImpulseResponses, ShiftErrors, impulse_responses, shift_errors
from sim.coding.section import AXES, ENERGIES, HALF_LENGTH, SPACING_MM, Energy, Sampling, sampled_section
from sim.config import FingertipConfig
from sim.measures.receptors import DEFAULT_DEPTH_MM

_FARTHEST = 0.75  # of the half length: beyond, few receptors are left to compare
Found = tuple[ImpulseResponses, ShiftErrors]


def command(
    spacing_mm: SpacingOption = SPACING_MM,
    half_length: HalfLengthOption = HALF_LENGTH,
    receptor_depth_mm: DepthOption = DEFAULT_DEPTH_MM,
    energy: EnergyOption = "finite",
    config: FingertipOption = None,
    picture: PictureOption = None,
    as_json: JsonOption = False,
) -> None:
    """Print h, g, f, how nearly h is −g, and what shifting them misses, in the skin's axes and in Cartesian ones."""
    with told_in_one_line(as_json=as_json):
        kind = named("--energy", energy, ENERGIES)
        samplings = [sampling_of(spacing_mm, half_length, receptor_depth_mm, axes) for axes in AXES]
        checked_picture(picture)
        finger = load_config(config).finger
        with busy("two plane-strain sections: about a second each …", as_json=as_json):
            found = {sampling.axes: _found(finger, sampling, kind) for sampling in samplings}
        if picture is not None:
            _draw(found, picture)
        if as_json:
            print_json({"energy": kind, **{axes: _as_json(*both) for axes, both in found.items()}})
        else:
            _print(found, kind)


def _found(finger: FingertipConfig, sampling: Sampling, energy: Energy) -> Found:
    section = sampled_section(finger, sampling)
    return impulse_responses(section), shift_errors(section, energy, int(_FARTHEST * sampling.half_length))


def _draw(found: dict[Any, Found], picture: Path) -> None:
    from rig.report.coding.impulse_figure import Drawn, impulse_figure  # matplotlib: only where a picture is wanted

    write_picture(impulse_figure({axes: Drawn(*both) for axes, both in found.items()}), picture)


def _as_json(responses: ImpulseResponses, errors: ShiftErrors) -> dict[str, Any]:
    frequency, amplitude = responses.spectra()
    return {
        "place_mm": responses.sampling.place_mm.tolist(),
        **{name: values.tolist() for name, values in zip(NAMES, responses.strain, strict=True)},
        "spectra": {
            "cycles_per_mm": frequency.tolist(),
            **{name: values.tolist() for name, values in zip(NAMES, amplitude, strict=True)},
        },
        "g_is_minus_h": responses.opposite._asdict(),
        "tails_over_peak": dict(zip(NAMES, responses.tails.tolist(), strict=True)),
        "shift_errors_relative_l2": {
            "place_mm": errors.place_mm.tolist(),
            **{name: values.tolist() for name, values in zip(("e11", "e22", "e12"), errors.strain, strict=True)},
            "sed": errors.sed.tolist(),
        },
    }


def _print(found: dict[Any, Found], energy: Energy) -> None:
    for axes, (responses, errors) in found.items():
        opposite = responses.opposite
        peaks = ", ".join(f"{name} {abs(v).max():.3g}" for name, v in zip(NAMES, responses.strain, strict=True))
        tails = ", ".join(f"{name} {v:.1%}" for name, v in zip(NAMES, responses.tails, strict=True))
        out.print(f"{axes} axes, {responses.strain.shape[1]} samples {responses.sampling.spacing_mm:g} mm apart")
        out.print(f"  peaks, per pseudo-unit on one sample  {peaks}")
        out.print(f"  ends over peak                        {tails}")
        out.print(
            f"  h + g over h                          {opposite.relative_l2:.1%} relative L2, "
            f"{opposite.largest:.1%} of the peak at most, r = {opposite.correlation:.4f}"
        )
        _print_errors(errors, energy)


def _print_errors(errors: ShiftErrors, energy: Energy) -> None:
    out.print("  what shifting them misses, relative L2")
    table = Table("  load at (mm)", "e11", "e22", "e12", f"SED ({energy})", box=None, padding=(0, 2))
    every = max(1, len(errors.place_mm) // 12)
    for k in range(0, len(errors.place_mm), every):
        table.add_row(f"{errors.place_mm[k]:.2f}", *(f"{v:.1%}" for v in errors.strain[:, k]), f"{errors.sed[k]:.1%}")
    out.print(table)
