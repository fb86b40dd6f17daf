"""A fit at rest on a mesh of fewer segments, where much is compared and little of it kept.

What is computed there only leads on: starts are compared, and moves of the rope for the noise, on
which a slightly other shape has no effect. What the mesh changes of the fit itself is corrected.
"""

from __future__ import annotations

from ropefit.inference.least_squares import Fit, attempted


def on_coarse_mesh(fitted: Fit) -> Fit:
    """Return a fit on the coarser mesh of its model, with the difference of the two meshes, at its
    own values, added to every shape; the fit itself where there is no such mesh, or the rope does
    not settle on it."""
    if fitted.coarse is None:
        fitted.coarse = _on_coarse_mesh(fitted) or fitted
    return fitted.coarse


def _on_coarse_mesh(fitted: Fit) -> Fit | None:
    coarse = fitted.forward.coarsened(fitted.point)
    if coarse is None:
        return None
    found = attempted(coarse, fitted.problem, fitted.point.u, 1, tolerance=1e-4)
    return found if found is not None and len(found.z) == len(fitted.z) else None
