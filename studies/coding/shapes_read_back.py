"""Class and size of an indentor from noisy SED: by the skin under decoded pressures, and by templates of SED itself.

    .venv/bin/python -m studies.coding.shapes_read_back [SCENES] [chosen]

Bars that touch with both edges, cylinders and steps, of any size and place within ranges, pressed on a finer mesh; 30
dB over M receptors. Decoded by the default finger's section. With `chosen`: the scenes on which the skin's error was
chosen.
"""

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.coding.bayes import decode_profile
from sim.coding.encoding import noise_sd
from sim.coding.operators import ForwardOperator, at_receptors, centred, convolution, impulse_responses
from sim.coding.pressure import SectionSkin, frictionless
from sim.coding.receptor_readings import Readings
from sim.coding.section import SPACING_MM, SampledSection, Sampling, sampled_section
from sim.coding.shape_class import CLASSES, ShapeClass, classify_shape
from sim.config import FingertipConfig, MeshSpec, Tissue
from studies.coding.profiles_read_back import SAMPLES, SNR_DB, ProfilePress, default_section, finer_section
from studies.registry import show

Array = NDArray[np.float64]

SCENES, TEMPLATES = 20, 300  # of each class
SEED, CHOSEN_SEED, TEMPLATE_SEED = 3000, 300, 9000
OTHER_TISSUE = Tissue(e_dermis=0.065)
"""Of another finger: its SED differs by 10 % and more."""

STEPS = (1, 3, 5)
EVERY = (1, 2, 4, 7)  # samples between receptors
HEADER = (
    "receptors apart", "by", "class", "bar", "cylinder", "step",
    "width, mm", "within 0.2 mm", "diameter", "within 15 %",
)  # fmt: skip
Row = tuple[str, ...]
Guess = Callable[[Array], tuple[ShapeClass, float]]


@dataclass(frozen=True)
class DrawnPress:
    """A press of a class and a size: width, diameter; of a step its number."""

    name: ShapeClass
    size: float
    scene: ProfilePress


def main(scenes: int = SCENES, seed: int = SEED) -> None:
    """Print how often the class is right, and errors of size, for each way of reading."""
    print(f"{scenes} scenes a class, seeds {seed} …; chance is {1 / len(CLASSES):.0%}")
    show(HEADER, rows(scenes, seed))


def rows(scenes: int, seed: int = SEED) -> Iterator[Row]:
    """One for each way of reading; last by how much SED of the other finger differs."""
    same, finer = default_section(), finer_section()
    drawn = [draw(name, seed + k) for name in CLASSES for k in range(scenes)]
    sed = [felt(finer, one) for one in drawn]
    templates = [draw(name, TEMPLATE_SEED + k) for name in CLASSES for k in range(TEMPLATES)]
    known = np.array([felt(same, one) for one in templates])
    operator = frictionless(same, centred(SAMPLES + 1, SPACING_MM), "finite")
    for every in EVERY:
        at, apart = slice((every - 1) // 2, None, every), f"{every * SPACING_MM:.2f} mm"
        yield apart, "skin", *_row(drawn, sed, at, by_skin(at_receptors(operator, at), operator.skin))
        yield apart, "templates of SED", *_row(drawn, sed, at, by_templates(templates, known[:, at]))
    everywhere, apart, half = slice(None), f"{SPACING_MM:.2f} mm", SAMPLES // 2
    shifted = convolution(impulse_responses(same), SAMPLES, "finite")
    convolved = at_receptors(shifted, slice(half, half + len(same.place_mm)))
    yield apart, "skin, convolution", *_row(drawn, sed, everywhere, by_skin(convolved, operator.skin))
    other = sampled_section(FingertipConfig(tissue=OTHER_TISSUE, mesh=MeshSpec(level="fine")), Sampling())
    sed_of_other = [felt(other, one) for one in drawn]
    by = [np.linalg.norm(b - a) / np.linalg.norm(a) for a, b in zip(sed, sed_of_other, strict=True)]
    who = f"of another finger, SED {min(by):.0%} … {max(by):.0%} other"
    yield apart, f"skin, {who}", *_row(drawn, sed_of_other, everywhere, by_skin(operator, operator.skin))
    yield apart, f"templates of SED, {who}", *_row(drawn, sed_of_other, everywhere, by_templates(templates, known))


def draw(name: ShapeClass, seed: int) -> DrawnPress:
    """A bar deep enough to touch with both edges, a cylinder, or a step near its reference."""
    rng = np.random.default_rng((seed, CLASSES.index(name)))
    if name == "bar":
        width = rng.uniform(1.2, 2.8)
        return DrawnPress(
            name,
            width,
            ProfilePress(f"bar:{width:.3f}", rng.uniform(-0.2, 0.2), 0.45 + 0.25 * width + rng.uniform(0, 0.2)),
        )
    if name == "cylinder":
        diameter = rng.uniform(2.5, 10.0)
        return DrawnPress(
            name, diameter, ProfilePress(f"cylinder:{diameter:.3f}", rng.uniform(-0.5, 0.5), rng.uniform(0.5, 1.0))
        )
    number = int(rng.choice(STEPS))
    return DrawnPress(name, number, ProfilePress(f"step:{number}", rng.uniform(-2.0, -1.2), rng.uniform(0.65, 0.9)))


def felt(section: SampledSection, drawn: DrawnPress) -> Array:
    """(m,) SED without noise."""
    scene = drawn.scene
    press = section.finger.indent(scene.shape, scene.x_mm, doi_mm=scene.doi_mm)
    return np.asarray(press.receptor_measures["sed"])


def by_skin(operator: ForwardOperator, skin: SectionSkin) -> Guess:
    """From decoded pressures."""

    def guess(reading: Array) -> tuple[ShapeClass, float]:
        found = classify_shape(skin, decode_profile(operator, Readings.of_sed(reading[:-1], reading[-1])).pressure)
        return found.name, found.size_mm

    return guess


def by_templates(templates: list[DrawnPress], known: Array) -> Guess:
    """The nearest in SED."""

    def guess(reading: Array) -> tuple[ShapeClass, float]:
        nearest = templates[int(((known - reading[:-1]) ** 2).sum(axis=1).argmin())]
        return nearest.name, nearest.size

    return guess


def _row(drawn: list[DrawnPress], sed: list[Array], at: slice, guess: Guess) -> Row:
    found = []
    for k, whole in enumerate(sed):
        signal = whole[at]
        sd = noise_sd(signal, SNR_DB)
        said = signal + sd * np.random.default_rng((k, len(signal))).normal(size=len(signal))
        found.append(guess(np.append(said, sd)))
    right = np.array([name == one.name for (name, _), one in zip(found, drawn, strict=True)])
    each = [right[[one.name == name for one in drawn]].mean() for name in CLASSES]
    off = {
        name: np.array(
            [size - one.size for (said, size), one in zip(found, drawn, strict=True) if said == one.name == name]
        )
        for name in ("bar", "cylinder")
    }
    true = np.array([one.size for (said, _), one in zip(found, drawn, strict=True) if said == one.name == "cylinder"])
    share = off["cylinder"] / true
    cells = [f"{right.mean():.0%}", *(f"{value:.0%}" for value in each)]
    cells += [_told(off["bar"], "{:+.2f} ± {:.2f}"), _within(off["bar"], 0.2)]
    return (*cells, _told(100 * share, "{:+.0f} ± {:.0f} %"), _within(share, 0.15))


def _within(off: Array, most: float) -> str:
    return f"{(np.abs(off) <= most).mean():.0%}" if len(off) else "–"


def _told(values: Array, form: str) -> str:
    return form.format(values.mean(), values.std()) if len(values) else "–"


if __name__ == "__main__":
    numbers = [int(word) for word in sys.argv[1:] if word.isdigit()] or [SCENES]
    main(numbers[0], CHOSEN_SEED if "chosen" in sys.argv else SEED)
