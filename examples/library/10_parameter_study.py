"""A parameter study: the same presses on fingers that differ, as one tidy table.

On many cores or machines, or beside recordings, `rig study` does this from a file: docs/parameter_studies.md.
"""

import itertools

import numpy as np

from sim import Fingertip, FingertipConfig, MeshSpec, Tissue, indent_many, write_csv


def main(
    mesh: MeshSpec,
    epidermis_mm: tuple[float, ...] = (0.3, 0.4, 0.5),
    bone_fraction: tuple[float, ...] = (0.26, 0.32, 0.38),
) -> int:
    tables = []
    for thickness, bone in itertools.product(epidermis_mm, bone_fraction):
        finger = Fingertip.load(FingertipConfig(mesh=mesh, tissue=Tissue(epidermis_mm=thickness, bone_fraction=bone)))
        found = indent_many(finger, ["bar:1.5", "cylinder:9"], doi_mm=0.4)
        table = found.table()
        varied = {"epidermis_mm": thickness, "bone_fraction": bone}
        tables.append({name: np.full(len(found), value) for name, value in varied.items()} | table)
    joined = {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}
    write_csv("study.csv", joined)
    print(f"{len(joined['shape'])} rows in study.csv")
    return len(joined["shape"])


if __name__ == "__main__":
    main(MeshSpec())
