"""TouchSim beside our classes: what the same population and stimulus cost in one run, and some of the 18 tests.

.venv/bin/python -m studies run nerve-touchsim

TouchSim is not on PyPI. Put a clone of https://github.com/hsaal/touchsim and its requirement scikit-image on
PYTHONPATH; without them nothing is measured, and the reason is printed.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compare.example import recorded
from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from sim.nerve.integrator import MOST_STEP_S
from sim.nerve.population import AfferentPopulation, draw
from sim.nerve.stimulus import Stimulus
from studies.nerve import published as pub
from studies.nerve.rows import BAR_SPEED_MM_S, over_seeds, rate_errors, variation
from studies.nerve.scenes import PRELOAD_MM, SETTLED_S, counts, ramp
from studies.registry import show

Array = NDArray[np.float64]

MISSING = (
    "TouchSim is not installed (a clone of github.com/hsaal/touchsim and scikit-image on PYTHONPATH): it is left out"
)
RATE_HZ = 5000.0
"""Sampling rate of its stimuli, that of its neurons."""
PROBE_MM = 0.5
"""Radius of the probe."""
POPULATION = "40xSA1,53xRA,7xPC"
"""A hundred afferents in the proportions of a monkey's fingertip."""
REPEATS = 5
MODELS = {"SA1": 4, "RA": 9, "PC": 4}
"""Numbers of its fitted neurons."""
BAR_MM, PIN_MM = (3.0, 6.0), 0.25
"""Width and length of the bar, and spacing of its pins."""

COST = ("stimulus of 1 s", "program", "part", "wall s", "processor s")
HEADER = ("test", "published", "TouchSim", "verdict")


def touchsim() -> Any | None:
    """Return TouchSim, or None without it."""
    try:
        return import_module("touchsim")
    except ImportError:
        return None


class Spent(NamedTuple):
    """Least wall and processor time of some calls (s)."""

    wall_s: float
    processor_s: float


def spent(action: Callable[[], object], repeats: int = REPEATS) -> Spent:
    """Return what a call costs, after one that is not counted."""
    action()
    found = []
    for _ in range(repeats):
        wall, processor = time.perf_counter(), time.process_time()
        action()
        found.append((time.perf_counter() - wall, time.process_time() - processor))
    return Spent(*(min(column) for column in zip(*found, strict=True)))


# --- cost ---


def trace(stimulus: Stimulus, lasts_s: float) -> Array:
    """Return the depth of a stimulus as TouchSim reads it; out of contact it is 0."""
    t = np.arange(round(lasts_s * RATE_HZ)) / RATE_HZ
    return np.maximum(stimulus.depth_mm(t) + stimulus.vibration_mm(t), 0.0)


def bar_pins() -> Array:
    """Return the pins of the bar, shape (n_pins, 2)."""
    x, z = (np.arange(-side / 2 + PIN_MM / 2, side / 2, PIN_MM) for side in BAR_MM)
    return np.stack([grid.ravel() for grid in np.meshgrid(x, z)], axis=1)


def costs(ts: Any, finger: Fingertip) -> Iterator[tuple[str, ...]]:
    """Yield what a press and hold of 1 s costs both programs, part by part."""
    stimulus = Stimulus.ramp(0.5, 10.0, 0.8, begins_s=0.05, away_mm=0.1)
    depth = trace(stimulus, 1.0)
    drawn = draw(finger, POPULATION, 1)
    theirs = ts.AfferentPopulation(
        *[ts.Afferent(one.model, location=np.array([[one.x_mm, one.along_mm]]), idx=0) for one in drawn]
    )
    pins = bar_pins()
    shapes: dict[str, tuple[str, Callable[[], Any]]] = {
        "probe of 1 mm": (
            f"flat:{PROBE_MM}",
            lambda: ts.Stimulus(trace=depth[None], location=np.zeros((1, 2)), fs=RATE_HZ, pin_radius=PROBE_MM),
        ),
        f"bar of 3 mm, {len(pins)} pins": (
            "bar:3.0",
            lambda: ts.Stimulus(
                trace=np.tile(depth, (len(pins), 1)), location=pins, fs=RATE_HZ, pin_radius=PIN_MM / 2
            ),
        ),
    }
    for what, (indentor, make) in shapes.items():
        with np.errstate(under="ignore"):  # TouchSim makes numpy warn of these everywhere
            yield from list(_ours(what, finger, drawn, indentor, stimulus))
        made = make()
        for part, action in (("stimulus", make), ("spikes", lambda made=made: theirs.response(made))):
            yield what, "TouchSim", part, *_seconds(spent(action))


def _ours(
    what: str, finger: Fingertip, drawn: AfferentPopulation, indentor: str, stimulus: Stimulus
) -> Iterator[tuple[str, ...]]:
    yield what, "sim.nerve", "16 presses", *_seconds(spent(lambda: drawn.pressed(finger, indentor, 0.5), 1))
    skin = drawn.pressed(finger, indentor, stimulus.deepest_mm)
    for step_s in (MOST_STEP_S, 1e-3):
        part = f"spikes, step {1e3 * step_s:g} ms"
        cost = spent(lambda step_s=step_s: drawn.spikes(skin.signal(stimulus, step_s, 1.0)))  # type: ignore[misc]
        yield what, "sim.nerve", part, *_seconds(cost)


def _seconds(cost: Spent) -> tuple[str, str]:
    return f"{cost.wall_s:.3f}", f"{cost.processor_s:.3f}"


# --- tests ---


def answered(ts: Any, name: str, depth: Array, repeats: int = REPEATS, pins: Array | None = None) -> list[Array]:
    """Return the spike times of all neurons of a class under the middle of an indentor, repeat after repeat."""
    return answered_at(ts, name, depth, [0.0] * repeats, pins)


def answered_at(ts: Any, name: str, depth: Array, x_mm: Sequence[float], pins: Array | None = None) -> list[Array]:
    """Return the spike times of all neurons of a class at each place, from the middle of the indentor."""
    where = np.zeros((1, 2)) if pins is None else pins
    made = ts.Stimulus(
        trace=np.tile(depth, (len(where), 1)),
        location=where,
        fs=RATE_HZ,
        pin_radius=PROBE_MM if pins is None else PIN_MM / 2,
    )
    asked = [ts.Afferent(name, location=np.array([[x, 0.0]]), idx=k) for x in x_mm for k in range(MODELS[name])]
    return [np.asarray(one) for one in ts.AfferentPopulation(*asked).response(made).spikes]


def decline(ts: Any) -> Iterator[tuple[str, ...]]:
    """Test 1."""
    for depth_mm, known in ((0.65, 38), (1.3, 36)):
        down_s = 0.1 + depth_mm / 0.4
        trains = answered(ts, "SA1", trace(ramp(depth_mm, 0.4, 12.0), down_s + 12.0))
        first, last = (counts(trains, down_s + at, down_s + at + 1) for at in (0, 10.9))
        found = 100 * (1 - last.sum() / first.sum())
        yield "1, SA1", f"{depth_mm:g} mm: {known} %", f"{found:.0f} %".replace("-", "−"), _verdict(25 <= found <= 50)


def irregularity(ts: Any) -> Iterator[tuple[str, ...]]:
    """Test 5, at two depths: its rates at the first may be outside those of the test."""
    for depth_mm in (0.6, 1.0):
        trains = answered(ts, "SA1", trace(ramp(depth_mm, 10.0, 5.0), 4.9))
        rates = counts(trains, 0.66, 4.66) / 4
        found = variation(trains, 0.66, 4.66)
        text = f"{over_seeds(found.tolist())}, {len(found)} trains" if len(found) else "no train at 10–40 /s"
        yield (
            f"5, SA1, {depth_mm:g} mm",
            "CV .78 (mouse), .3–.6 (primate)",
            f"{text}; {rates.min():.0f} to {rates.max():.0f} /s",
            _verdict(len(found) > 0 and 0.3 <= float(found.mean()) <= 0.9),
        )


def bar(ts: Any) -> Iterator[tuple[str, ...]]:
    """Test 6: the mean profile of its neurons."""
    x = recorded("static").position_mm
    down_s = 1.0 / BAR_SPEED_MM_S
    depth = trace(ramp(1.0, BAR_SPEED_MM_S, 1.5), 0.1 + down_s + 1.4)
    runs = [answered_at(ts, "SA1", depth, (-x).tolist(), bar_pins()) for _ in range(REPEATS)]
    windows = {
        "dynamic": (0.1, 0.1 + down_s, 2, 4),
        "static": (0.3 + down_s, 1.3 + down_s, 6, 9),
    }
    for phase, (begin_s, end_s, low, high) in windows.items():
        rate = np.mean([counts(trains, begin_s, end_s) for trains in runs], axis=0) / (end_s - begin_s)
        profiles = rate.reshape(len(x), MODELS["SA1"])
        mean, known = profiles.mean(axis=1), recorded(phase).rate
        r = float(np.corrcoef(mean, known)[0, 1])
        each = [float(np.corrcoef(one, known)[0, 1]) for one in profiles.T]
        ratio = float(mean.max() / max(mean[np.abs(x) <= 0.7].mean(), 0.5))
        yield (
            f"6, SA1 {phase}",
            f"edge : center {low}–{high}; r ≥ .9",
            f"mean of four neurons {ratio:.1f}; r {r:.2f} (each {min(each):.2f} to {max(each):.2f})",
            _verdict(low <= ratio <= high and r >= 0.9),
        )


def silent(ts: Any) -> Iterator[tuple[str, ...]]:
    """Test 9."""
    on_s = 0.1 + 1 / 30
    off_s = on_s + 1.0
    depth = trace(ramp(1.0, 30.0, 1.0), 1.8)
    for name in ("RA", "PC", "SA1"):
        trains = answered(ts, name, depth)
        on, hold, off = (
            counts(trains, *window).sum()
            for window in ((0, on_s + 0.1), (on_s + 0.1, off_s - 0.02), (off_s - 0.02, 1.8))
        )
        late = counts(trains, off_s + 0.02, 1.8).mean()
        if name == "SA1":
            yield f"9, {name}", "nothing on retraction", f"{late:.2f} impulses", _verdict(late <= 1)
        else:
            text, passed = f"hold {hold:.0f} impulses; off/on {off / max(on, 1):.2f}", hold == 0
            yield f"9, {name}", "nothing in the hold; on and off", text, _verdict(passed and 0.3 <= off / on <= 1.2)


def muniak(ts: Any) -> Iterator[tuple[str, ...]]:
    """Tests 11 and 12, on which it was fitted."""
    tests = [
        *(("11", name, 50.0, *known) for name, known in pub.VIBRATION_50_HZ.items()),
        ("12", "PC", 300.0, *pub.VIBRATION_300_HZ),
    ]
    t = np.arange(-SETTLED_S, 1.0, 1 / RATE_HZ)
    rise = np.sin(0.5 * np.pi * np.clip(2 * (t + SETTLED_S) / SETTLED_S, 0.0, 1.0)) ** 2
    for number, name, frequency, amplitudes, known in tests:
        rates = []
        for amplitude_um in (0.0, *amplitudes):
            wave = np.where(t >= 0, 1e-3 * amplitude_um * np.sin(2 * np.pi * frequency * t), 0.0)
            trains = answered(ts, name, PRELOAD_MM * rise + wave)
            rates.append(float(counts(trains, SETTLED_S + 0.1, SETTLED_S + 0.9).mean() / 0.8))
        found = np.array(rates[1:]) - (rates[0] if name == "SA1" else 0.0)
        median, mean = rate_errors(found, known)
        yield (
            f"{number}, {name}",
            ", ".join(f"{one:g}" for one in known),
            ", ".join(f"{one:.0f}".replace("-", "−") for one in found)
            + f"; median \\|e\\| {median:.2f}, \\|mean e\\| {mean:.2f}",
            _verdict(median <= 0.5 and mean <= 0.3),
        )


def _verdict(passed: object) -> str:
    return "pass" if passed else "fail"


TESTS = (decline, irregularity, bar, silent, muniak)


def main() -> None:
    """Print both tables."""
    ts = touchsim()
    if ts is None:
        print(MISSING)
        return
    show(COST, costs(ts, load("finger")))
    print()
    show(HEADER, (row for test in TESTS for row in test(ts)))


if __name__ == "__main__":
    main()
