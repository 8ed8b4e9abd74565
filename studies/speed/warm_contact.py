"""A load cell sampled while the finger is pressed: what each sample costs, and how right is what is served between.

    .venv/bin/python -m studies.speed.warm_contact    # some minutes

Each shape is pressed 1 mm deep at 1 mm/s by the virtual bench's own press (`sim/plant.py`), which goes on
from the last sample's contact. At 100 Hz every sample is solved. At 1 kHz most are served from answers at 100 Hz:
*behind*, as if nothing were known of the stage's path, by extrapolation from answers that have had a period to be
solved in; *ahead*, where the path is planned and the next pose solved before it is reached, by interpolation. The
errors of both are against solving each millisecond, over the largest force.

The last table is of the load cell itself, on the wall clock: `rig serve`'s own way (`sim/serve/prefetch.py`, the
finger in a second process) with a carriage on its way down, asked at every hundredth or thousandth of a second.
"""

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.carriage import Carriage, Placement, Pose, Screws
from sim.config import FingertipConfig
from sim.models.fingertip import Fingertip
from sim.plant import PressedFinger
from sim.serve.force_process import PressProcess
from sim.serve.prefetch import PressAhead
from sim.serve.real_time_loop import WallScheduler
from sim.workers import keep_freed_memory
from studies.posix import os

Array = NDArray[np.float64]

SCENES = {
    "bar 3.0": ("bar:3.0", 0.0),
    "bar 1.5": ("bar:1.5", 0.0),
    "step 1": ("step:1", -1.63),
    "step 5": ("step:5", -1.63),
    "cylinder 9": ("cylinder:9", 0.0),
    "sphere 5": ("sphere:5", 0.0),
}
DEPTH_MM, SPEED_MM_S = 1.0, 1.0
SOLVED_HZ, SERVED_HZ = 100, 1000
DEADLINE_S = 1 / SOLVED_HZ
DESCENTS = 3
ORDERS = (1, 2)


@dataclass(frozen=True)
class PressSamples:
    """Samples on the way down."""

    t_s: Array  # since first touch
    force_n: Array
    wall_s: Array
    cpu_s: Array  # of the process


def pressed(finger: Fingertip, shape: str, x_mm: float, t_s: Array) -> PressSamples:
    """The force at each instant of a descent from first touch, each solved on from the one before."""
    press = PressedFinger(finger, shape)
    touch_mm = finger.touch_height_mm(shape, x_mm) - finger.apex_height_mm
    force, wall, cpu = np.empty((3, len(t_s)))
    for k, t in enumerate(t_s):
        clocks = time.perf_counter(), time.process_time()
        force[k] = press.force_n(Pose(x_mm, touch_mm - SPEED_MM_S * float(t)))
        wall[k], cpu[k] = time.perf_counter() - clocks[0], time.process_time() - clocks[1]
    return PressSamples(t_s, force, wall, cpu)


def behind(solved: PressSamples, t_s: Array, order: int) -> Array:
    """Forces at (n,) instants by a polynomial through the last answers that are a period old."""
    period = solved.t_s[1] - solved.t_s[0]
    t = np.concatenate([-period * np.arange(order + 2, -1, -1), solved.t_s])  # nothing is felt before first touch
    f = np.concatenate([np.zeros(order + 3), solved.force_n])
    last = np.searchsorted(t, t_s - period + 1e-9, side="right") - 1
    known = last[:, None] - np.arange(order + 1)
    return _through(t[known], f[known], t_s)


def ahead(solved: PressSamples, t_s: Array) -> Array:
    """Forces at (n,) instants, linear between the answers before and after."""
    return np.interp(t_s, np.append(0.0, solved.t_s), np.append(0.0, solved.force_n))


def _through(t: Array, f: Array, at: Array) -> Array:
    """Lagrange's polynomials through (n, k) values at (n, k) instants, each at one of (n,) instants."""
    others = ~np.eye(t.shape[1], dtype=bool)
    over = np.where(others, t[:, :, None] - t[:, None, :], 1.0)
    ratio = np.where(others, at[:, None, None] - t[:, None, :], 1.0) / over
    return np.asarray((f * ratio.prod(axis=2)).sum(axis=1))


def largest(found: Array, exact: Array) -> float:
    """Largest deviation over the largest force, per cent."""
    return float(100 * np.abs(found - exact).max() / exact.max())


def times(seconds: Array) -> str:
    """p50 / p99 / max in ms."""
    return " / ".join(f"{1e3 * v:.1f}" for v in (*np.percentile(seconds, [50, 99]), seconds.max()))


@dataclass(frozen=True)
class Served:
    """Samples of the load cell at their instants."""

    delay_s: Array  # from the instant until the force is there
    fresh: NDArray[np.bool_]  # not the force of an instant before
    force_n: Array
    exact_n: Array


def served(finger: Fingertip, shape: str, x_mm: float, hz: float) -> Served:
    """A descent on the wall clock, after half a second of rest above the finger."""
    top_mm = finger.touch_height_mm(shape, x_mm) - finger.apex_height_mm
    scheduler, screws, period_s = WallScheduler(), Screws(), 1 / hz
    start_s = np.inf

    def steps_at(t_s: float) -> tuple[int, int, int]:
        z_mm = top_mm - SPEED_MM_S * min(max(t_s - start_s, 0.0), DEPTH_MM / SPEED_MM_S)
        return round(screws.x_steps_per_mm * x_mm), 0, round(screws.z_steps_per_mm * z_mm)

    carriage = Carriage(steps_at, screws, Placement(0.0, 0.0))
    ahead = PressAhead(scheduler, carriage, PressProcess(FingertipConfig(), shape), period_s, print)
    start_s = DEADLINE_S * round((scheduler.monotonic_s() + 0.5) / DEADLINE_S)
    instants = start_s + period_s * np.arange(1, round(DEPTH_MM / SPEED_MM_S * hz) + 1)
    delay, fresh, force, poses = [], [], [], []
    for t_s in instants.tolist():
        while scheduler.monotonic_s() < t_s:
            scheduler.run_once(t_s)
        fresh.append(ahead.fresh(t_s))
        force.append(ahead.force_n(t_s))
        delay.append(scheduler.monotonic_s() - t_s)
        poses.append(carriage.pose_at(t_s))
    ahead.close()
    scheduler.close()
    exact = PressedFinger(finger, shape)
    return Served(np.array(delay), np.array(fresh), np.array(force), np.array([exact.force_n(p) for p in poses]))


def served_table(finger: Fingertip) -> None:
    """Some descents of each shape."""
    head = ["shape", "asked at (Hz)", "delay, p50 / p99 / max (ms)", "fresh (%)", "error, p99 / max (%)"]
    print(f"\n| {' | '.join(head)} |\n|{'---|' * len(head)}")
    for name, (shape, x_mm) in SCENES.items():
        for hz in (SOLVED_HZ, SERVED_HZ):
            runs = [served(finger, shape, x_mm, hz) for _ in range(DESCENTS)]
            delay, fresh = (np.concatenate([getattr(run, what) for run in runs]) for what in ("delay_s", "fresh"))
            off = np.concatenate([np.abs(run.force_n - run.exact_n) / run.exact_n.max() for run in runs])
            error = " / ".join(f"{100 * v:.2f}" for v in (np.percentile(off, 99), off.max()))
            print(f"| {name} | {hz} | {times(delay)} | {100 * fresh.mean():.1f} | {error} |", flush=True)


def main() -> None:
    """Print the tables; this process, too, keeps its memory, as that of `rig serve` does."""
    keep_freed_memory()
    finger = Fingertip.load()
    head = ["shape", "force at 1 mm (N)", "wall (ms)", "CPU (ms)", "over 10 ms, wall / CPU"]
    head += [*(f"served behind, order {order} (%)" for order in ORDERS), "served ahead (%)"]
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}; times are p50 / p99 / max\n")
    print(f"| {' | '.join(head)} |\n|{'---|' * len(head)}")
    for name, (shape, x_mm) in SCENES.items():
        pressed(finger, shape, x_mm, np.array([0.01]))  # loads the model that this kind of shape needs
        coarse, fine = (
            pressed(finger, shape, x_mm, np.arange(1, round(hz * DEPTH_MM / SPEED_MM_S) + 1) / hz)
            for hz in (SOLVED_HZ, SERVED_HZ)
        )
        late = " / ".join(f"{100 * (s > DEADLINE_S).mean():.0f} %" for s in (coarse.wall_s, coarse.cpu_s))
        served = [behind(coarse, fine.t_s, order) for order in ORDERS] + [ahead(coarse, fine.t_s)]
        errors = [f"{largest(f, fine.force_n):.2f}" for f in served]
        cells = [name, f"{coarse.force_n[-1]:.4f}", times(coarse.wall_s), times(coarse.cpu_s), late, *errors]
        print(f"| {' | '.join(cells)} |", flush=True)
    served_table(finger)


if __name__ == "__main__":
    main()
