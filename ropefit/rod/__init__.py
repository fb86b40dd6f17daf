"""The mechanics of the rod: state, frames, strains, rest shape. No solver here."""

from ropefit.rod.strains import Rest, bend_twist, distance, straight_rest, stretch_shear

__all__ = ["Rest", "bend_twist", "distance", "straight_rest", "stretch_shear"]
