"""A thousand random presses on all cores, with progress; answers as a table, failures as rows with a reason."""

import numpy as np

from sim import Fingertip, Indentations, indent_many, write_csv


def main(finger: Fingertip, poses: int = 1000, cores: int | None = None) -> Indentations:
    rng = np.random.default_rng(0)
    shapes = rng.choice(["bar:3.0", "cylinder:9", "step:5", "sphere:5"], poses).tolist()
    found = indent_many(
        finger,
        shapes,
        rng.uniform(-1.5, 1.5, poses),
        z_mm=[rng.uniform(6.0, 7.5) if shape.startswith("sphere") else np.nan for shape in shapes],  # nan: not given
        force_gwt=rng.uniform(0.5, 5.0, poses),
        cores=cores,
        progress=lambda done, of: print(f"\r{done} of {of}", end="", flush=True),
    )
    print(f"\n{found}")
    table = (
        found.table()
    )  # columns: to_pandas(table) and to_xarray(table) make more of them, where these are installed
    for shape in np.unique(table["shape"]):
        print(f"{shape}: {np.nanmean(table['doi_mm'][table['shape'] == shape]):.2f} mm deep on average")
    write_csv("presses.csv", table)
    write_csv("receptors.csv", found.receptor_table())
    return found


if __name__ == "__main__":
    main(Fingertip.load())
