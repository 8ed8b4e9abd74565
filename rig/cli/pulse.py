"""`rig pulse`: test pulses on the configured output, without motion."""

import statistics
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import Annotated, NotRequired

from rich.table import Table

from rig.bench.checks import refuse_bench
from rig.cli.bench import connected_stage
from rig.cli.options import ConfigOption, JsonOption, option
from rig.cli.output import busy, complain, out, print_json, resting, writes_json
from rig.cli.request import takes
from rig.cli.signals import at_once
from rig.clock import Clock, WallClock
from rig.devices.sync_line import CONFIRMED_S, AdapterOutput, StageOutput, SyncLine, send_pulse
from rig.errors import BadInputError
from rig.plan.config import Config, load_config
from rig_shared.outputs import Name, Output


class SentPulseJson(Output):
    """A test pulse; times in s since the request for the first one."""

    requested_s: float
    rise_s: float
    """When the output had confirmed the rise."""
    uncertainty_s: float
    """The rise may have been earlier by as much."""
    width_s: float
    answer_s: NotRequired[float | None]
    """With --loopback: time from the request until the input showed the rise; null if it never did."""


class SentPulsesJson(Output):
    """Test pulses that were sent."""

    output: Name
    pulses: list[SentPulseJson]
    median_uncertainty_s: float
    worst_uncertainty_s: float


@dataclass(frozen=True)
class PulseRequest:
    """Options of `rig pulse`."""

    config: ConfigOption
    count: Annotated[int, option("Number of pulses, {within}.", "N", within=(1, 1000))] = 10
    every_s: Annotated[float, option("Time from one pulse to the next, in s, {within}.", "S", within=(0.01, 60))] = (
        1.0
    )
    width_s: Annotated[
        float | None, option("Width of a pulse, in s, {within}. Default: sync.width_s.", "S", within=(0.001, 1))
    ] = None
    loopback: Annotated[
        bool, option("Also time the input that a wire joins with the line: CTS with RTS, DSR with DTR.")
    ] = False
    as_json: JsonOption = False


@takes(PulseRequest)
def pulse_command(request: PulseRequest) -> None:
    """Send test pulses on the configured output, to check the channel of an amplifier; nothing moves."""
    settings = load_config(request.config)
    refuse_bench(settings)
    sync = settings.sync
    width_s = sync.width_s if request.width_s is None else request.width_s
    if sync.output == "off":
        raise BadInputError(
            'sync.output = "off": no output is configured; set an output of the stage, or rts:PORT or dtr:PORT',
            "no_output",
        )
    if width_s >= request.every_s:
        raise BadInputError(
            f"--every-s {request.every_s:g}: must exceed the width of a pulse, {width_s:g} s", "pulses_overlap"
        )
    if request.loopback and sync.adapter is None:
        raise BadInputError(
            "--loopback: only RTS and DTR of an adapter have an input beside them; set sync.output to rts:PORT or "
            "dtr:PORT",
            "no_loopback",
        )
    with busy("sending pulses …", quick=True), _opened(settings) as (line, clock), resting():
        pulses = list(_sent(line, clock, request, width_s))
    spread_s = [one["uncertainty_s"] for one in pulses]
    found: SentPulsesJson = {
        "output": sync.output,
        "pulses": pulses,
        "median_uncertainty_s": statistics.median(spread_s),
        "worst_uncertainty_s": max(spread_s),
    }
    if writes_json():
        print_json(found)
    else:
        _print(found, sync.name)
    if any(one.get("answer_s", 0.0) is None for one in pulses):
        complain("the input did not follow every pulse; join CTS with RTS, or DSR with DTR")


@contextmanager
def _opened(settings: Config) -> Iterator[tuple[SyncLine, Clock]]:
    """Open only what sends the pulses."""
    if settings.sync.adapter is None:
        with connected_stage(settings) as (stage, clock):
            yield StageOutput(stage, clock), clock
    else:
        clock = WallClock()
        with at_once(), closing(AdapterOutput(settings.sync, clock)) as line:
            yield line, clock


def _sent(line: SyncLine, clock: Clock, request: PulseRequest, width_s: float) -> Iterator[SentPulseJson]:
    """Send the pulses, and yield each when it has ended."""
    begun_s = clock.monotonic_s()
    for number in range(request.count):
        clock.wait_s(max(begun_s + number * request.every_s - clock.monotonic_s(), 0.0))
        answered = list[float]()

        def listen(answered: list[float] = answered) -> None:
            until_s = clock.monotonic_s() + min(CONFIRMED_S, width_s)
            while isinstance(line, AdapterOutput) and not answered and clock.monotonic_s() < until_s:
                if line.answers():
                    answered.append(clock.monotonic_s())

        sent = send_pulse(line, clock, width_s, listen if request.loopback else None)
        one: SentPulseJson = {
            "requested_s": round(sent.requested_s - begun_s, 6),
            "rise_s": round(sent.rise_s - begun_s, 6),
            "uncertainty_s": round(sent.uncertainty_s, 6),
            "width_s": round(sent.width_s, 6),
        }
        if request.loopback:
            one["answer_s"] = round(answered[0] - sent.requested_s, 6) if answered else None
        yield one


def _print(found: SentPulsesJson, output: str) -> None:
    pulses = found["pulses"]
    looped = "answer_s" in pulses[0]
    table = Table("pulse", "requested (s)", "confirmed (s)", "uncertainty (ms)", "width (ms)", box=None)
    if looped:
        table.add_column("input (ms)")
    for number, one in enumerate(pulses, 1):
        answer_s = one.get("answer_s")
        table.add_row(
            str(number),
            f"{one['requested_s']:.4f}",
            f"{one['rise_s']:.4f}",
            f"{1000 * one['uncertainty_s']:.2f}",
            f"{1000 * one['width_s']:.2f}",
            *(["none" if answer_s is None else f"{1000 * answer_s:.2f}"] if looped else []),
        )
    out.print(table)
    out.print(
        f"{output}: a rise was confirmed {1000 * found['median_uncertainty_s']:.2f} ms after its request "
        f"(median; {1000 * found['worst_uncertainty_s']:.2f} ms at most)"
    )
