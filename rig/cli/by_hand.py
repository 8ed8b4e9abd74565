"""What the commands share that move a stage by hand: the guard of its force, and what the last command left."""

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager

from rich.live import Live

from rig.cli.at_the_bench import stage_at_hand
from rig.cli.output import err
from rig.devices.drivers import open_force
from rig.devices.stage.base import StageStatus
from rig.engine.by_hand import ByHand, Show
from rig.engine.by_hand.bench_memory import BenchMemory
from rig.engine.sensing import Sensing
from rig.plan.config import Config
from rig.session.by_hand.at_hand import at_hand, feel, unfelt
from rig.transport import TransportError
from rig.transport.clock import Clock


@contextmanager
def by_hand(settings: Config, show: Show, *, without_force: bool) -> Iterator[tuple[ByHand, Clock]]:
    """Motions on the ports of the configuration. Raises BadInputError where no force sensor answers."""
    known = BenchMemory(settings).read()
    with (
        stage_at_hand(settings) as (stage, clock),
        _sensing(settings, clock, without=without_force) as sensing,
        at_hand(settings, stage, clock, sensing, show, known) as hand,
    ):
        yield hand, clock


@contextmanager
def _sensing(settings: Config, clock: Clock, *, without: bool) -> Iterator[Sensing | None]:
    if without:
        err.print("without force: nothing stops the stage at a finger")
        yield None
        return
    try:
        sensor = open_force(settings, clock)
    except TransportError as error:
        raise unfelt(error) from None
    with closing(sensor):
        yield feel(Sensing(settings, clock, sensor))


@contextmanager
def live_line(settings: Config) -> Iterator[Show]:
    """Where the stage is and what is felt, on a line that is kept up to date where somebody looks."""
    if not err.is_terminal:
        yield lambda at, force_gwt: None
        return
    with Live(console=err, transient=True, refresh_per_second=10) as live:
        yield _shown(live.update, settings)


def _shown(update: Callable[[str], None], settings: Config) -> Show:
    apex_mm = settings.frame.apex_z_mm

    def show(at: StageStatus, force_gwt: float | None) -> None:
        force = "no force" if force_gwt is None else f"{force_gwt:.2f} gwt"
        update(f"x {at.x_mm:.3f}  y {at.y_mm:.3f}  z {at.z_mm:.3f} mm (apex {apex_mm:g})  {force}  {at.state}")

    return show
