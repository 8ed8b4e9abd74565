"""A finger of your own shape: a table of sections along it, from the proximal edge to the tip."""

from sim import Fingertip, FingertipConfig, Geometry, MeshSpec

# z, half-width, height of the pulp above the bone's axis, lateral shift; mm. Yours may come from a file:
# Geometry.model_validate({"sections": "mine.csv", "length_mm": 14.0})
SECTIONS = (
    (0.0, 4.0, 3.0, -0.6),
    (3.0, 4.9, 4.2, -0.5),
    (6.0, 5.1, 5.1, -0.2),
    (9.0, 4.8, 5.2, 0.1),
    (12.0, 3.6, 4.0, 0.1),
    (14.0, 1.1, 1.1, 0.0),
)


def main(mesh: MeshSpec) -> Fingertip:
    geometry = Geometry(length_mm=14.0, sections=SECTIONS)
    finger = Fingertip.load(FingertipConfig(geometry=geometry, receptor_plane_from_tip_mm=6.4, mesh=mesh))
    print(f"highest at {finger.apex_height_mm:.2f} mm; {finger.indent('sphere:4', force_gwt=2.0)}")
    return finger


if __name__ == "__main__":
    main(MeshSpec())
