"""`rig stranger`: the truth of a finger that `rig serve --stranger` served, beside what was learned of it."""

import math
from pathlib import Path
from typing import Annotated, Any

import typer

from rig.cli.options import JsonOption
from rig.cli.output import out, print_json, told_in_one_line
from rig.plan.met.finger_file import Met, read_finger_file
from rig.session.meeting.stranger import truth_of
from sim.identification.bands import standard_deviations
from sim.identification.prior import named, plain


def command(
    seed: Annotated[int, typer.Argument(min=0, help="The stranger's.")],
    beside: Annotated[Path | None, typer.Option(metavar="TOML", help="The file that `rig meet` wrote.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Each number of the finger; with a file its 90 % band, and whether the truth lies in it."""
    with told_in_one_line(as_json=as_json):
        truth = truth_of(seed)
        met = None if beside is None else read_finger_file(beside).met
        found = {named(name): _beside(name, value, met) for name, value in truth.items()}
        if as_json:
            print_json(found)
            return
        for name, one in found.items():
            out.print(f"{name:<14}{one['truth']:<8.3g}{_band(one)}")


def _beside(name: str, value: float, met: Met | None) -> dict[str, Any]:
    """Logarithms as what they are of."""
    told: dict[str, Any] = {"truth": plain(name, value)}
    if met is None or name not in met.posterior.names:
        return told
    k = met.posterior.names.index(name)
    mean, sd = met.posterior.mean[k], math.sqrt(met.posterior.covariance[k][k])
    low, high = (mean + sign * standard_deviations() * sd for sign in (-1, 1))
    return {**told, "low": plain(name, low), "high": plain(name, high), "in": low <= value <= high}


def _band(one: dict[str, Any]) -> str:
    return "" if "low" not in one else f"  met {one['low']:.3g} … {one['high']:.3g}{'' if one['in'] else '  !'}"
