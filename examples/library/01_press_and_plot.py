"""Press a bar into the finger; plot pressure on the skin and strain energy at the receptors."""

import matplotlib.pyplot as plt

from sim import Fingertip, IndentationResult


def main(finger: Fingertip, doi_mm: float = 1.0) -> IndentationResult:
    result = finger.indent("bar:3.0", x_mm=0.0, doi_mm=doi_mm)
    print(f"{result.force_gwt:.2f} gwt, contact at x = {result.contact_regions_mm} mm")

    figure, (skin, receptors) = plt.subplots(2, sharex=True, layout="constrained")
    skin.plot(*result.pressure_profile)
    skin.set_ylabel("pressure (pseudo-units)")
    table = result.receptor_table()
    receptors.plot(table["x_mm"], table["sed"], "o-")
    receptors.set(xlabel="x (mm)", ylabel="strain energy density")
    figure.savefig("press.svg")
    plt.close(figure)
    return result


if __name__ == "__main__":
    main(Fingertip.load())
