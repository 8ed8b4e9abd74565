"""A finger with other layers: a thinner epidermis over a softer fat; what is left out keeps its default."""

from sim import Fingertip, FingertipConfig, MeshSpec, Tissue


def main(mesh: MeshSpec) -> dict[str, float]:
    fingers = {
        "default": FingertipConfig(mesh=mesh),
        "thin and soft": FingertipConfig(mesh=mesh, tissue=Tissue(epidermis_mm=0.3, e_fat=0.05)),
    }
    force_gwt = {}
    for name, config in fingers.items():
        finger = Fingertip.load(config)  # built once, then from the cache
        force_gwt[name] = finger.indent("cylinder:9", doi_mm=0.5).force_gwt
        print(f"{name}: {force_gwt[name]:.2f} gwt at 0.5 mm, {config}")
    return force_gwt


if __name__ == "__main__":
    main(MeshSpec())
