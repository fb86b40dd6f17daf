"""Confounding: effects that the rope's own parameters explain as well."""

from __future__ import annotations

import numpy as np

from ropefit.diagnosis.sensitivities import Sensitivity
from ropefit.inference.least_squares import Fit

CONFOUNDED_SHARE = 0.9  # of an effect's change of the shapes
LEAST_SIGNAL = 6.0  # signal to noise of an effect of usual size, if the rope were known


def confounded(fit: Fit, sensitivities: list[Sensitivity]) -> list[str]:
    """Return a sentence on every effect with advice for it that the rope's parameters reproduce.

    At its worst place, and only where rope parameters are fitted freely: known from another
    recording they reproduce nothing.
    """
    terms = fit.forward.terms
    rope = np.repeat([t.log for t in terms], [t.size for t in terms]) & ~fit.prior.held
    if not rope.any():
        return []
    basis, _ = np.linalg.qr(fit.jacobian[:, rope])
    names = ", ".join(t.name for t in terms if t.log and not np.isfinite(t.prior).all())
    out = []
    for one in sensitivities:
        advice = one.hypothesis.effect.confounding
        if not advice:
            continue
        s = one.values[:, :, 0]
        whole = (s**2).sum(0)
        share = ((basis.T @ s) ** 2).sum(0) / np.maximum(whole, 1e-300)
        share[whole < LEAST_SIGNAL**2] = 0.0
        worst = int(share.argmax())
        if share[worst] > CONFOUNDED_SHARE:
            out.append(
                f"{one.hypothesis.name} at {one.hypothesis.places[worst, 0]:.3f} m: {names} "
                f"reproduces {100 * share[worst]:.0f} % of what it does; {advice}"
            )
    return out
