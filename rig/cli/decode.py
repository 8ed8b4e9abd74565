"""`rig decode`: pressure on the skin, read back from what receptors under it say."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from rig.cli.coded import pressed
from rig.cli.decode_options import axial_of, encoding_of, operator_of, receptor_of, refuse_together, search_of
from rig.cli.decode_said import as_json_object, draw, print_decoded
from rig.cli.decode_sources import task_of_press, task_of_pressures, task_of_readings, tasks_of_row
from rig.cli.decoding import DECODERS, Answer, DecoderName, Search, Task, best_explained, decode
from rig.cli.options import FingertipOption, JsonOption
from rig.cli.output import THE_FINGER, busy, print_json, told_in_one_line
from rig.cli.pictures import PictureOption, checked_picture
from rig.cli.pressures import read_pressures
from rig.cli.readings_file import read_readings
from rig.cli.sampling import (
    DepthOption,
    EnergyOption,
    HalfLengthOption,
    NoisePlaceOption,
    SnrOption,
    SpacingOption,
    named,
    sampling_of,
)
from rig.errors import code_of, fields_of
from rig.plan.config import load_config
from rig.protocol.errors import BadInputError
from sim.coding.operators import OPERATORS
from sim.coding.search import DecodingError
from sim.coding.section import HALF_LENGTH, SPACING_MM
from sim.measures.receptors import DEFAULT_DEPTH_MM


def command(
    pressure: Annotated[
        str | None, typer.Option(metavar="P", help="Encode these first: 20,14, or a CSV with a column pressure.")
    ] = None,
    shape: Annotated[str | None, typer.Option(metavar="S", help="Or press this, prismatic along z.")] = None,
    readings: Annotated[
        Path | None,
        typer.Option(metavar="FILE.csv", help="Or take these: places, depths, readings, noise; with z_mm a sheet."),
    ] = None,
    axial: Annotated[
        str | None,
        typer.Option(metavar="A", help="Of a row in the whole finger: ellipse:HALF-LENGTH in mm; ellipse: the best."),
    ] = None,
    x_mm: Annotated[float, typer.Option(metavar="X", help="Of the indentor's reference point.")] = 0.0,
    doi_mm: Annotated[float | None, typer.Option(metavar="D", help="How deep it is pressed.")] = None,
    decoder: Annotated[str, typer.Option(metavar="NAME", help=", ".join(DECODERS))] = "ours",
    operator: Annotated[
        str | None, typer.Option(metavar="O", help=f"{' or '.join(OPERATORS)}; absent: the first for --pressure.")
    ] = None,
    energy: EnergyOption = "finite",
    snr_db: SnrOption = None,
    noise: NoisePlaceOption = "receptor",
    gain: Annotated[
        str | None,
        typer.Option(metavar="K", help="Of the receptor, in R = k (S − S₀); 30±2 with its standard error."),
    ] = None,
    threshold: Annotated[
        str | None, typer.Option(metavar="S0", help="Of the receptor, 1.5±0.2 likewise; absent: no receptor.")
    ] = None,
    start: Annotated[str | None, typer.Option(metavar="P", help="Where univariate and grid begin: 10,10.")] = None,
    within: Annotated[
        str | None, typer.Option("--range", metavar="LOW,HIGH", help="Of pressures, for all decoders but ours.")
    ] = None,
    grid_step: Annotated[
        float | None, typer.Option(metavar="P", help="Of grid; absent: a 30th of the range.")
    ] = None,
    seed: Annotated[int, typer.Option(metavar="N", help="Of the noise, and of what is drawn at random.")] = 0,
    spacing_mm: SpacingOption = SPACING_MM,
    half_length: HalfLengthOption = HALF_LENGTH,
    receptor_depth_mm: DepthOption = DEFAULT_DEPTH_MM,
    config: FingertipOption = None,
    picture: PictureOption = None,
    as_json: JsonOption = False,
) -> None:
    """Print the pressures found, how sure they are and, where the true ones are known, how wrong."""
    with told_in_one_line(as_json=as_json):
        refuse_together(pressure, shape, readings, snr_db=snr_db, operator=operator, doi_mm=doi_mm)
        name, by = named("--decoder", decoder, DECODERS), operator_of(operator, pressures=pressure is not None)
        how = encoding_of(energy, noise, snr_db, seed, receptor_of(gain, threshold))
        search = search_of(name, start, within, grid_step, seed)
        sampling = sampling_of(spacing_mm, half_length, receptor_depth_mm)
        half_lengths = axial_of(axial, name, readings)
        checked_picture(picture)
        finger = load_config(config).finger
        make: Callable[[], Task | list[Task]]
        what = "the plane-strain section: about a second …"
        if pressure is not None:
            samples = read_pressures(pressure)
            make = partial(task_of_pressures, finger, sampling, by, how, samples)
        elif shape is not None:
            scene = pressed(shape, x_mm, doi_mm)
            make = partial(task_of_press, finger, sampling, by, how, scene)
        else:
            assert readings is not None
            given = read_readings(readings, finger)
            what = what if given.z_mm is None and axial is None else THE_FINGER
            if half_lengths:
                make = partial(tasks_of_row, finger, how, given, spacing_mm, half_lengths)
            else:
                make = partial(task_of_readings, finger, how, given, spacing_mm, contacts=name == "ours")
        with busy(what, as_json=as_json):
            task, answer = _answered(make, name, search)
        if picture is not None:
            draw(task, answer, picture)
        if as_json:
            print_json({"decoder": name, **as_json_object(finger, task, answer)})
        else:
            print_decoded(finger, name, task, answer)


def _answered(make: Callable[[], Task | list[Task]], decoder: DecoderName, search: Search) -> tuple[Task, Answer]:
    """Of several tasks of the same readings the one that explains them best."""
    try:
        made = make()
        task = made if isinstance(made, Task) else best_explained(made)
        return task, decode(task, decoder, search)
    except DecodingError as error:
        raise BadInputError("{problem}", code=code_of(error), **{**fields_of(error), "problem": str(error)}) from None
