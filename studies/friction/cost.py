"""Time of a press with friction beside one without, and the size of both models, on the default finger.

    OMP_NUM_THREADS=1 .venv/bin/python -m studies.friction.cost

Both are measured in one run, as processor time of the contact solver; each press starts from rest.
"""

from statistics import median

from sim.contact.indentor import ALONG, BOTH
from sim.models.catalogue import load
from sim.models.friction import FrictionResult

SCENES = (("bar:3.0", 1.0), ("cylinder:9", 1.0), ("step:1", 0.73))
FRICTION = 0.3
PLACES_MM = (0.0,)


def main() -> None:
    """Print the table."""
    finger = load("finger")
    finger.indent("bar:3.0", doi_mm=0.1, friction=0.3)
    for name, model in (
        ("without", finger.model),
        ("with", finger._with_all_axes[ALONG].model_for(BOTH)),
    ):
        size_mb, built_s = model.patch.compliance.nbytes / 1e6, sum(model.timing_s.values())
        print(
            f"model {name} friction: {size_mb:.0f} MB, {built_s:.1f} s to build (0 where it was in the cache)",
            flush=True,
        )
    print("| scene | without friction, ms | friction 0.3, ms | times | increments | largest residual |")
    print("|---|---|---|---|---|---|")
    for shape, doi_mm in SCENES:
        smooth = [1e3 * finger.indent(shape, x, doi_mm=doi_mm).contact_s for x in PLACES_MM]
        results = [finger.indent(shape, x, doi_mm=doi_mm, friction=FRICTION) for x in PLACES_MM]
        rubbed = median(1e3 * one.contact_s for one in results)
        increments = max(one.increments for one in results if isinstance(one, FrictionResult))
        print(
            f"| {shape}, {doi_mm:g} mm | {median(smooth):.0f} | {rubbed:.0f} | {rubbed / median(smooth):.0f} | "
            f"{increments} | {max(one.state.residual for one in results):.0e} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
