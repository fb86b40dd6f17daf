"""A fit at rest on a mesh of fewer segments, where much is compared and little of it kept.

What is computed there only leads on: starts are compared, and moves of the rope for the noise, on
which a slightly other shape has no effect. What the mesh changes of the fit itself is corrected.
"""

from __future__ import annotations

from ropefit.inference.least_squares import Fit, attempted
from ropefit.models.equilibrium import Equilibrium
from ropefit.solvers.equilibrium.solution import at_nodes_of


def on_coarse_mesh(fitted: Fit) -> Fit:
    """Return a fit on the coarser mesh of its model, with the difference of the two meshes, at its
    own values, added to every shape; the fit itself where there is no such mesh, the rope does not
    settle on it, or remembers, which would have to be gone through again."""
    if fitted.coarse is None:
        fitted.coarse = _on_coarse_mesh(fitted) or fitted
    return fitted.coarse


def _on_coarse_mesh(fitted: Fit) -> Fit | None:
    model, solution, u = fitted.forward, fitted.point.solution, fitted.point.u
    if not isinstance(model, Equilibrium) or model.coarser is None or fitted.point.setup.remembers:
        return None
    base = model.coarser
    states = solution.of_segments(base.segments)
    rough = Equilibrium(base, model.terms, states).at(u)
    if not rough.converged.all():
        return None
    drift = at_nodes_of(base.segments, solution.x) - rough.solution.x
    corrected = base._replace(sensor=base.sensor._replace(drift=drift))
    coarse = Equilibrium(corrected, model.terms, rough.solution)
    found = attempted(coarse, fitted.problem, u, 1, tolerance=1e-4)
    return found if found is not None and len(found.z) == len(fitted.z) else None
