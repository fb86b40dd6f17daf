"""Effects that the rope's own parameters take up: what shapes alone cannot tell."""

from __future__ import annotations

import numpy as np

from ropefit.effects import PointMass
from ropefit.inference.diagnosis.columns import Columns
from ropefit.inference.least_squares import Fit

MOST = 0.9  # of what an effect does to the shapes
STRONG = 6.0  # signal over noise that an effect of usual size would have if the rope were known


def absorbed(fit: Fit, columns: list[Columns]) -> list[str]:
    """Sentences on masses that a softer rope would pass for, at the worst place.

    Only where rope parameters are fitted freely: known from another recording they take up nothing.
    """
    terms = fit.forward.terms
    rope = np.repeat([t.log for t in terms], [t.size for t in terms]) & ~np.isfinite(fit.prior)
    if not rope.any():
        return []
    basis, _ = np.linalg.qr(fit.jacobian[:, rope])
    names = ", ".join(t.name for t in terms if t.log and not np.isfinite(t.prior).all())
    out = []
    for column in columns:
        if not isinstance(column.family.effect, PointMass):
            continue
        s = column.values[:, :, 0]
        whole = (s**2).sum(0)
        share = ((basis.T @ s) ** 2).sum(0) / np.maximum(whole, 1e-300)
        share[whole < STRONG**2] = 0.0
        worst = int(share.argmax())
        if share[worst] > MOST:
            out.append(
                f"point_mass at {column.family.places[worst, 0]:.3f} m: {names} takes up "
                f"{100 * share[worst]:.0f} % of what it does; shapes cannot tell a heavier place "
                "from a softer rope: weigh it, or record the rope without and give that run as "
                "--nominal"
            )
    return out
