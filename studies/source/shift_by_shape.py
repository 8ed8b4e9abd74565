"""What convolution makes of presses on the whole finger: one place's response moved, against finite elements.

.venv/bin/python -m studies.source.shift_by_shape    # a minute
"""

from collections.abc import Iterator

from sim.coding.point_loaded_finger import LoadedFinger
from sim.coding.point_spread import MovedResponse, receptor_sheet
from sim.config import FingertipConfig
from sim.models.fingertip import Fingertip
from studies.registry import show

SCENES = {
    "cylinder:3": (0.0, 0.67),
    "cylinder:9": (0.0, 0.67),
    "bar:3.0": (0.0, 0.67),
    "bar:1.5": (0.0, 0.67),
    "step:1": (-1.63, 0.73),
    "step:5": (-1.63, 0.73),
    "sphere:3": (0.0, 0.67),
}
"""x and DOI of each shape, mm."""

HEADER = ("shape", "relative L2", "peak", "lateral", "normal alone")


def rows(response: MovedResponse, finger: Fingertip) -> Iterator[tuple[str, ...]]:
    """One row for each shape."""
    for shape, (x_mm, doi_mm) in SCENES.items():
        missed = response.missed_of_press(finger.indent(shape, x_mm, doi_mm=doi_mm))
        yield (
            shape,
            f"{missed.relative_l2:.1%}",
            f"{missed.peak:+.1%}",
            f"{missed.lateral_share:.0%}",
            f"{missed.normal_alone:.1%}",
        )


def main() -> None:
    """Print the table."""
    loaded = LoadedFinger(FingertipConfig())
    response = MovedResponse.of(loaded, receptor_sheet(loaded))
    show(HEADER, rows(response, Fingertip.load()))


if __name__ == "__main__":
    main()
