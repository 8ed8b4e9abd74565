"""Contact jobs of CalculiX on the default mesh beside ours: a quarter of an hour or more, 3 GB; needs `ccx`.

    .venv/bin/python -m studies.accuracy.calculix_jobs

Fully integrated elements and contact at nodes in both; deck and settings are `sim/models/full_mesh.py`'s.
"""

from sim.benchmark import compare
from sim.config import Contact, FingertipConfig, MeshSpec

LIKE_WITH_LIKE = FingertipConfig(mesh=MeshSpec(element="full"), contact=Contact(between_nodes=False))
SCENES = (("cylinder:9", 0.67), ("bar:3.0", 0.8))


def main() -> None:
    """Print the table."""
    print("| scene | nodes | CalculiX: N | CPU s | here: N | model, s | a further contact, CPU ms | ratio |")
    print("|---|---|---|---|---|---|---|---|")
    for shape, doi_mm in SCENES:
        found = compare(LIKE_WITH_LIKE, shape, doi_mm)
        print(
            f"| {found.scene} | {found.nodes} | {found.force_n:.6f} | {found.cpu_s:.0f} | {found.our_force_n:.6f} | "
            f"{found.our_build_s:.0f} | {1e3 * found.our_cpu_s:.1f} | {found.cpu_s / found.our_cpu_s:.0f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
