"""Impulse responses of the plane-strain section, and encoding by them (Figs 6-5 to 6-7)."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from rig.report.coding_figures import DrawnEncoding, encoding_figure, impulse_figure
from rig.report.coding_figures import DrawnImpulse as DrawnResponses
from rig.report.page import PageFigure, Section
from sim.coding.encoding import Encoded, Noise, encode
from sim.coding.operators import ImpulseResponses, ShiftErrors, convolution, impulse_responses, shift_errors
from sim.coding.section import AXES, HALF_LENGTH, SPACING_MM, Axes, SampledSection, Sampling, sampled_section
from sim.coding.task import SectionPress, SkinLoad, load_of_press
from sim.config import FingertipConfig
from sim.contact.shapes import parse_shape
from studies.coding.two_samples import TRUE

Row = tuple[str, ...]

_DRAWN_SHAPE = "bar:3.0"
_SNR_DB = 20.0
SCENES = {
    "cylinder:3": (0.0, 0.67),
    "cylinder:9": (0.0, 0.67),
    "bar:3.0": (0.0, 0.67),
    "bar:1.5": (0.0, 0.67),
    "step:1": (-1.63, 0.73),
    "step:5": (-1.63, 0.73),
}
"""x and DOI of each shape, mm."""

_SHAPE_HEADER = ("shape", "relative L2", "peak", "lateral", "in Cartesian axes")


class Coded(NamedTuple):
    """What a process sends back."""

    responses: Mapping[Axes, tuple[ImpulseResponses, ShiftErrors]]
    by_shape: Sequence[Row]
    press: SkinLoad
    said_of_press: Encoded
    two: SkinLoad
    said_of_two: Encoded


def section_coded() -> Coded:
    """Some ten seconds of one core."""
    sections = {axes: sampled_section(FingertipConfig(), Sampling(SPACING_MM, HALF_LENGTH, axes)) for axes in AXES}
    farthest = int(0.75 * HALF_LENGTH)
    responses = {
        axes: (impulse_responses(section), shift_errors(section, "finite", farthest))
        for axes, section in sections.items()
    }
    pressed = {shape: _pressed(sections, shape) for shape in SCENES}
    press = pressed[_DRAWN_SHAPE]["skin"]
    two = SkinLoad(convolution(responses["skin"][0], len(TRUE), "finite"), TRUE)
    noise = Noise(_SNR_DB)
    return Coded(
        responses,
        [_shape_row(shape, told) for shape, told in pressed.items()],
        press,
        encode(press.operator, press.pressure, None, noise),
        two,
        encode(two.operator, TRUE, None, noise),
    )


def _pressed(sections: Mapping[Axes, SampledSection], shape: str) -> dict[Axes, SkinLoad]:
    press = SectionPress(parse_shape(shape), *SCENES[shape])
    return {axes: load_of_press(section, "convolution", "finite", press) for axes, section in sections.items()}


def _shape_row(shape: str, told: Mapping[Axes, SkinLoad]) -> Row:
    skin, cartesian = (told[axes].missed or {} for axes in AXES)
    return (
        shape,
        f"{skin['relative_l2']:.1%}",
        f"{skin['peak']:+.1%}",
        f"{skin['lateral_share']:.0%}",
        f"{cartesian['relative_l2']:.0%}",
    )


def section_sections(found: Coded) -> list[Section]:
    """Two."""
    rows = tuple(_response_row(axes, *both) for axes, both in found.responses.items())
    responses = Section(
        "Impulse responses of the section",
        "h, g and f (e11, e22, e12) 0.76 mm below the skin under a point load on the plane-strain section, 170 µm "
        "apart, "
        "per pseudo-unit of pressure on one sample (§6.5). The source: h and g low-pass, nearly equal and "
        "opposite; f "
        "band-pass; in Cartesian axes. Shifting: relative L2 at loads 2 mm from the middle.",
        (
            "axes",
            "peaks of h, g, f (10⁻⁵)",
            "h + g over h",
            "r of h and g",
            "ends over peak",
            "shifting misses e11, e22, e12",
            "SED",
        ),
        rows,
        (
            PageFigure(
                "h, g, f, their spectra, and what shifting them misses",
                impulse_figure({axes: DrawnResponses(*both) for axes, both in found.responses.items()}),
                "After Fig. 6-5. Left: in the skin's axes; right: Cartesian, as the source.",
            ),
        ),
    )
    captions = (
        (found.two, found.said_of_two, f"P = {TRUE.tolist()}", "The worked example of §6.7."),
        (
            found.press,
            found.said_of_press,
            f"{_DRAWN_SHAPE} pressed 0.67 mm deep",
            "Dashed: finite elements of the same press.",
        ),
    )
    encoding = Section(
        "Encoding",
        "Pressure → P∗h, P∗g, P∗f → SED → noise → what the receptor says (Figs 6-6 and 6-7); SED with the tissue's "
        "own "
        "compression (finite). Below: convolution against finite elements of the same press of the section.",
        _SHAPE_HEADER,
        tuple(found.by_shape),
        tuple(
            PageFigure(
                f"Encoding of {name}",
                encoding_figure(DrawnEncoding(told.operator, told.pressure, said, told.true)),
                f"{caption} Noise of {_SNR_DB:g} dB over M = {said.samples} samples, sd {said.share_of_peak:.1%} "
                "of the peak.",
            )
            for told, said, name, caption in captions
        ),
    )  # fmt: skip
    return [responses, encoding]


def _response_row(axes: str, responses: ImpulseResponses, errors: ShiftErrors) -> Row:
    two_mm = np.isclose(np.abs(errors.place_mm), 12 * SPACING_MM)
    missed = errors.strain[:, two_mm].max(axis=1)
    peaks = 1e5 * responses.strain[range(3), np.abs(responses.strain).argmax(axis=1)]
    return (
        axes,
        ", ".join(f"{v:.1f}" for v in peaks),
        f"{responses.opposite.relative_l2:.0%}",
        f"{responses.opposite.correlation:.4f}",
        ", ".join(f"{v:.0%}" for v in responses.tails),
        ", ".join(f"{v:.0%}" for v in missed),
        f"{errors.sed[two_mm].max():.0%}",
    )
