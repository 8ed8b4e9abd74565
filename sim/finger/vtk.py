"""Finger meshes as legacy VTK files, for example for ParaView."""

from pathlib import Path

import numpy as np

from sim.finger.mesh import FingerMesh, MeshQuality

_CELL_TYPES = {8: 12, 27: 29}  # hexahedron, triquadratic hexahedron


def write_vtk(path: Path, mesh: FingerMesh, quality: MeshQuality) -> None:
    """Write nodes in mm and hexahedra with layer (0 epidermis … 3 bone), scaled Jacobian and aspect ratio.

    Format: Kitware, VTK file formats, legacy, version 3.0, ASCII.
    """
    n, k = mesh.hexes.shape
    with path.open("w", encoding="ascii") as file:
        file.write("# vtk DataFile Version 3.0\nfinger mesh, mm\nASCII\nDATASET UNSTRUCTURED_GRID\n")
        file.write(f"POINTS {len(mesh.nodes)} double\n")
        np.savetxt(file, mesh.nodes, "%.9g")
        file.write(f"CELLS {n} {(k + 1) * n}\n")
        np.savetxt(file, np.insert(mesh.hexes, 0, k, axis=1), "%d")
        file.write(f"CELL_TYPES {n}\n")
        np.savetxt(file, np.full(n, _CELL_TYPES[k]), "%d")
        file.write(f"CELL_DATA {n}\n")
        for name, values in (
            ("layer", mesh.layer),
            ("scaled_jacobian", quality.scaled_jacobian),
            ("aspect_ratio", quality.aspect_ratio),
        ):
            file.write(f"SCALARS {name} double 1\nLOOKUP_TABLE default\n")
            np.savetxt(file, values, "%.6g")
