"""`rig check`: what a protocol will do, before anything moves."""

import math
from typing import Any

from rich.table import Table

from rig.cli.options import FingerConfigOption, JsonOption, MetFingerOption, MoreArgument, ProtocolArgument, SetOption
from rig.cli.output import THE_FINGER, busy, checking_the_script, out, print_json, told_in_one_line
from rig.plan.config import load_config, with_finger
from rig.plan.plan import make_plan
from rig.protocol.script import load_script
from rig.session.bench_problems import refuse_bench
from rig.session.preflight import preflight
from sim.models.fingertip import Fingertip

_COLUMNS = {
    "index": "",
    "indentor": "",
    "x_mm": "x (mm)",
    "doi_mm": "DOI (mm)",
    "force_gwt": "force (gwt)",
    "mean_pressure_n_cm2": "mean pressure (N/cm²)",
    "peak_pressure_n_cm2": "peak (N/cm²)",
    "overshoot_gwt": "overshoot at a trip (gwt)",
}


def command(
    protocol: ProtocolArgument,
    more: MoreArgument = None,
    set_: SetOption = None,
    config: FingerConfigOption = None,
    finger_file: MetFingerOption = None,
    as_json: JsonOption = False,
) -> None:
    """Walk through the script against the limits and the finger model, and rehearse it on springs."""
    with told_in_one_line(as_json=as_json):
        settings = with_finger(load_config(config), finger_file)
        refuse_bench(settings)
        script = load_script(protocol, [*(set_ or []), *(more or [])])
        with busy(THE_FINGER, as_json=as_json):
            finger = Fingertip.load(settings.finger)
        with checking_the_script() as told:
            plan = make_plan(script, settings, finger, told=told)
        with busy("rehearsing on springs …", as_json=as_json):
            found = preflight(script, settings, finger, plan).as_json()
        if as_json:
            print_json({"protocol": script.name, **found})
        else:
            _tell(found)


_MET_COLUMNS = {
    "index": "",
    "indentor": "",
    "x_mm": "x (mm)",
    "doi_mm": "DOI (mm)",
    "doi_band_mm": "9 in 10",
    "force_gwt": "force (gwt)",
    "force_band_gwt": "9 in 10",
}


def _tell(found: dict[str, Any]) -> None:
    columns = _MET_COLUMNS if "force_band_gwt" in found["steps"][0] else _COLUMNS
    table = Table(*(title or name for name, title in columns.items()), box=None)
    for step in found["steps"]:
        table.add_row(*(_short(step[name]) for name in columns))
    out.print(table)
    left = found["margins"]
    for line in (
        f"{found['indentations']} indentations and {found['other_presses']} other presses in "
        f"{found['duration_s']:.0f} s, the finger touched for {found['contact_s']:.0f} s of them",
        f"peak {found['peak_force_gwt']:.4g} gwt, {found['peak_pressure_n_cm2']:.3g} N/cm²",
        found["small_strain"]["note"],
        f"soft trip {found['soft_trip_n']:.3g} N, hard trip {found['hard_trip_n']:.3g} N",
        f"left {left['force_gwt']:.3g} gwt, DOI {left['doi_mm']:.3g} mm, {left['mean_pressure_n_cm2']:.3g} N/cm², "
        f"{left['contact_s']:.0f} s of contact",
        f"stop distance {found['stop_distance_mm']:.3g} mm, {found['overshoot_gwt']:.3g} gwt above a trip at most",
    ):
        out.print(line)


def _short(value: object) -> str:
    if isinstance(value, list):
        low, high = value
        return "asked for" if math.isclose(low, high, rel_tol=1e-6) else f"{low:.3g}–{high:.3g}"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
