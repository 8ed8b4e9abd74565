"""`rig encode`: from pressure on the skin of the section to what receptors under it say."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from rig.cli.coded import Told, pressed, told, told_of_press
from rig.cli.options import FingertipOption, JsonOption
from rig.cli.output import busy, out, print_json, told_in_one_line
from rig.cli.pictures import PictureOption, checked_picture, write_picture
from rig.cli.pressures import read_pressures
from rig.cli.sampling import (
    DepthOption,
    EnergyOption,
    HalfLengthOption,
    NoisePlaceOption,
    SnrOption,
    SpacingOption,
    bounded,
    named,
    sampling_of,
)
from rig.plan.config import load_config
from rig.protocol.errors import BadInputError
from sim.coding.encoding import NOISE_PLACES, Encoded, Noise, Receptor, encode
from sim.coding.operators import OPERATORS
from sim.coding.section import ENERGIES, HALF_LENGTH, SPACING_MM, sampled_section
from sim.measures.receptors import DEFAULT_DEPTH_MM

_ROWS = 25


def command(
    pressure: Annotated[
        str | None, typer.Option(metavar="P", help="Samples as 20,14, or a CSV with a column pressure.")
    ] = None,
    shape: Annotated[str | None, typer.Option(metavar="S", help="Press this instead, prismatic along z.")] = None,
    x_mm: Annotated[float, typer.Option(metavar="X", help="Of the indentor's reference point.")] = 0.0,
    doi_mm: Annotated[float | None, typer.Option(metavar="D", help="How deep it is pressed.")] = None,
    operator: Annotated[str, typer.Option(metavar="O", help=" or ".join(OPERATORS))] = "convolution",
    energy: EnergyOption = "finite",
    snr_db: SnrOption = None,
    noise: NoisePlaceOption = "receptor",
    gain: Annotated[float, typer.Option(metavar="K", help="Of the receptor, in R = k (S − S₀).")] = 1.0,
    threshold: Annotated[
        float | None, typer.Option(metavar="S0", help="Of the receptor; absent: no receptor.")
    ] = None,
    seed: Annotated[int, typer.Option(metavar="N", help="Of the noise.")] = 0,
    spacing_mm: SpacingOption = SPACING_MM,
    half_length: HalfLengthOption = HALF_LENGTH,
    receptor_depth_mm: DepthOption = DEFAULT_DEPTH_MM,
    config: FingertipOption = None,
    picture: PictureOption = None,
    as_json: JsonOption = False,
) -> None:
    """Print SED and rates at the receptors; under a shape also how far the operator is from finite elements."""
    with told_in_one_line(as_json=as_json):
        kind, by = named("--energy", energy, ENERGIES), named("--operator", operator, OPERATORS)
        at, sampling = named("--noise", noise, NOISE_PLACES), sampling_of(spacing_mm, half_length, receptor_depth_mm)
        if (pressure is None) == (shape is None):
            raise BadInputError(
                "expected exactly one of {options}", code="exactly_one", options="--pressure and --shape"
            )
        added = (
            None
            if snr_db is None
            else Noise(bounded("--snr-db", snr_db, -40, 100), at, int(bounded("--seed", seed, 0, 2**32)))
        )
        receptor = (
            None
            if threshold is None
            else Receptor(bounded("--gain", gain, 1e-9, 1e9), bounded("--threshold", threshold, 0, 1e9))
        )
        checked_picture(picture)
        samples = None if pressure is None else read_pressures(pressure)
        scene = None if shape is None else pressed(shape, x_mm, doi_mm)
        with busy("the plane-strain section: about a second …", as_json=as_json):
            section = sampled_section(load_config(config).finger, sampling)
        if scene is None:
            assert samples is not None
            mine = told(section, by, kind, samples)
        else:
            mine = told_of_press(section, by, kind, scene)
        encoded = encode(mine.operator, mine.pressure, receptor, added)
        if picture is not None:
            _draw(mine, encoded, picture)
        if as_json:
            print_json(_as_json(mine, encoded))
        else:
            _print(mine, encoded, added)


def _draw(mine: Told, encoded: Encoded, picture: Path) -> None:
    from rig.report.coding.encoding_figure import Drawn, encoding_figure  # matplotlib: only where it is wanted

    write_picture(encoding_figure(Drawn(mine.operator, mine.pressure, encoded, mine.true)), picture)


def _as_json(mine: Told, encoded: Encoded) -> dict[str, Any]:
    return {
        "operator": mine.operator.name,
        "energy": mine.operator.energy,
        "pressure": {"place_mm": mine.operator.place_mm.tolist(), "pseudo": mine.pressure.tolist()},
        "receptor_mm": mine.operator.receptor_mm.tolist(),
        "sed": encoded.sed.tolist(),
        "rate": encoded.rate.tolist(),
        "samples": encoded.samples,
        "noise_sd": encoded.noise_sd,
        "noise_share_of_peak": encoded.share_of_peak,
        "against_finite_elements": mine.missed,
        "small_strain": None if mine.small_strain is None else mine.small_strain.as_json(),
    }


def _print(mine: Told, encoded: Encoded, added: Noise | None) -> None:
    operator = mine.operator
    out.print(
        f"{operator.name}, SED {operator.energy}: {len(mine.pressure)} pressures, M = {encoded.samples} receptors"
    )
    if added is not None:
        out.print(
            f"  noise at the {added.at}: {added.snr_db:g} dB over M = {encoded.samples} samples, "
            f"sd {encoded.noise_sd:.3g} = {encoded.share_of_peak:.2%} of the peak, seed {added.seed}"
        )
    if mine.missed is not None:
        out.print(
            f"  against finite elements: {mine.missed['relative_l2']:.1%} relative L2, "
            f"peak {mine.missed['peak']:+.1%}; {mine.missed['lateral_share']:.0%} of the force is lateral"
        )
    if mine.small_strain is not None:
        out.print(f"  {mine.small_strain.note}")
    table = Table("receptor at (mm)", "SED (pseudo)", "rate", box=None, padding=(0, 2))
    for k in np.unique(np.linspace(0, encoded.samples - 1, _ROWS).round().astype(int)).tolist():
        table.add_row(f"{operator.receptor_mm[k]:.2f}", f"{encoded.sed[k]:.4g}", f"{encoded.rate[k]:.4g}")
    out.print(table)
