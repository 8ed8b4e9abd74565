"""The finger on which errors were measured."""

from sim.config import FingertipConfig, Geometry, Tissue


def differences(tissue: Tissue) -> list[str]:
    """Return the keys that differ from the default tissue; `stiffness` scales all forces alike and does not count."""
    default = Tissue()
    names = [name for name in Tissue.model_fields if name != "stiffness"]
    return [name for name in names if getattr(tissue, name) != getattr(default, name)]


def is_default_finger(config: FingertipConfig) -> bool:
    """Return whether a finger is the default one, but for its mesh, its contact and its stiffness."""
    plane = FingertipConfig().receptor_plane_from_tip_mm
    return (
        config.geometry == Geometry()
        and not differences(config.tissue)
        and config.receptor_plane_from_tip_mm == plane
    )
