"""`rig stream`: readings and steps of runs in another process, as streams of the Lab Streaming Layer."""

from pathlib import Path
from typing import Annotated

import typer

from rig.cli.options import option
from rig.cli.output import ExitCode, err, reporting_errors, resting
from rig.clock import WallClock
from rig.data.lsl import MARKERS, SAMPLES, GrowingRuns, open_streams

LOOK_S = 0.02


@reporting_errors
def stream_command(
    out_dir: Annotated[Path, option("Parent folder of the run folders.", "DIR", name="--out")] = Path("runs"),
) -> None:
    """Offer readings and steps of the runs in a folder to the Lab Streaming Layer (LSL), until Ctrl-C.

    Every computer that reaches this one can read the streams: liblsl listens on all network interfaces.
    """
    streams, runs, clock = open_streams(), GrowingRuns(out_dir), WallClock()
    err.print(f"streams {SAMPLES} and {MARKERS} are open on all network interfaces; press Ctrl-C to close them")
    try:
        with resting():
            while True:
                for run, documents in runs.new():
                    streams.push(run, documents)
                clock.wait_s(LOOK_S)
    except KeyboardInterrupt:
        err.print("closed the streams; a run continues")
        raise typer.Exit(ExitCode.DONE) from None
