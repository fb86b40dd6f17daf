"""A rope whose stiffness and rest curve are free along it: the most flexible candidate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ropefit.diagnosis.candidate import SIZE_PRIOR_SD, Candidate, fit_candidate, occam_factor
from ropefit.diagnosis.hypotheses import Hypothesis
from ropefit.diagnosis.sensitivities import PROBE
from ropefit.effects.base import Effect, Quantity
from ropefit.inference.least_squares import Fit
from ropefit.models.terms import Term
from ropefit.rod.setup import Setup, twist_held

KNOTS = 8
NAME = "free_rope"
STIFFER = 5.0  # of the logarithm: bound of the stiffness at a knot


class FreeRope(Effect):
    """log EI over the nominal one and two components of the rest curvature [1/m], linear between
    knots. In no scan: it is fitted, never proposed."""

    name = NAME
    quantities = (
        *(Quantity(f"log_factor_{k}", "1", 0.5, -STIFFER, STIFFER) for k in range(KNOTS)),
        *(Quantity(f"curvature_1_{k}", "1/m", 0.3, by_length=-1.0) for k in range(KNOTS)),
        *(Quantity(f"curvature_2_{k}", "1/m", 0.3, by_length=-1.0) for k in range(KNOTS)),
    )

    def applies(self, setup: Setup) -> bool:
        return False

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        p = setup.properties
        share = (setup.arc[1:] - 0.5 * p.length) / p.length.sum()
        apart = np.abs(share[:, None] - np.linspace(0, 1, KNOTS))
        hats = np.maximum(1 - apart * (KNOTS - 1), 0)
        log, first, second = values.reshape(3, KNOTS) @ hats.T
        factor, turn = np.exp(log), np.stack([first, second, np.zeros_like(log)], axis=1)
        return setup._replace(
            properties=p._replace(
                bend=p.bend * factor, twist=p.twist * factor, curvature=p.curvature + turn
            )
        )

    def sentence(self, values: dict[str, float]) -> str:
        return "stiffness and rest curve differ from place to place along the rope"


class FreeHypothesis(Hypothesis):
    """Of usual size under a prior: nothing else holds what no frame shows."""

    def term(self, setup: Setup, values: np.ndarray) -> Term:
        term = super().term(setup, values)
        return replace(term, prior=SIZE_PRIOR_SD * term.scale)


def free_rope(smaller: Fit) -> Candidate | None:
    """The free rope fitted on top of a model. None if it cannot settle.

    Its log evidence is Laplace's, like every rival's: the priors are in its cost, and so must not
    be in the information that the data add to them.
    """
    hypothesis = FreeHypothesis(FreeRope(), np.zeros((1, 0)))
    start = np.zeros(3 * KNOTS)
    if not twist_held(smaller.point.setup):  # at zero curvature it has no slope
        start[KNOTS : 2 * KNOTS] = PROBE * hypothesis.scales(smaller.point.setup)[KNOTS : 2 * KNOTS]
    candidate = fit_candidate(smaller, hypothesis, start)
    if candidate is None:
        return None
    sd = candidate.fit.prior.sd.copy()
    sd[-candidate.term.size :] = np.inf
    loose = replace(candidate.fit, prior=replace(candidate.fit.prior, sd=sd))
    gained = occam_factor(candidate.fit, candidate.term) - occam_factor(loose, candidate.term)
    return replace(candidate, evidence=candidate.evidence + gained)
