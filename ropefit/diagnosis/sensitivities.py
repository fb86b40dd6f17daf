"""Whitened sensitivities of all stations to every effect at every place, without refit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ropefit.diagnosis.hypotheses import Hypothesis
from ropefit.inference.bins import aligned, collected
from ropefit.inference.least_squares import Fit
from ropefit.inference.noise import Whitener
from ropefit.models.response import Parts
from ropefit.models.terms import change_by

ALIKE_SHAPES = 1e-3  # of the length: shapes that differ by less answer alike
NEAR_IN_MOTION = 0.1  # of what is missed, rms: the same of motions
STRAIGHT = 1e-9  # of the rest vectors of bend elements
PROBE = 0.3  # of its usual size: where an effect is tried that has no derivative at zero


@dataclass(frozen=True)
class Sensitivity:
    """Of one hypothesis: values (M D, Q, k), changes per usual size of each quantity, whitened, of
    a rope `seen` (F, K, 3) [m]; moved (Q k, F, K, 3) [m] of the nodes, where the stations' places
    along the rope depend on its shape: neither in a motion, of which all frames of all clips are
    too many, nor of markers."""

    hypothesis: Hypothesis
    values: np.ndarray
    whitener: Whitener
    seen: np.ndarray
    moved: np.ndarray | None = None


class Sensitivities:
    """Compute sensitivities at a fit's point; what they share is computed once."""

    def __init__(self, fit: Fit) -> None:
        self.fit, self.point = fit, fit.point
        self.now = fit.problem.match(np.where(np.isfinite(fit.point.seen), fit.point.seen, 0.0))
        self.setup = fit.point.setup
        self.earlier: tuple[np.ndarray, np.ndarray] | None = None

    def of(self, hypothesis: Hypothesis, known: Sensitivity | None = None) -> Sensitivity:
        """Return the sensitivity to a hypothesis: by its loads, its tangent or finite responses, or
        from one that is known of a rope in nearly the same shapes."""
        s, shape = self.fit.stations, (len(hypothesis.places), hypothesis.size)
        if known is not None and self._alike(hypothesis, known):
            moved, seen = known.moved, known.seen
            rows = self._whitened_anew(known)
        else:
            parts = (
                (frames, np.nan_to_num(dx, copy=False)) for frames, dx in self._nodes(hypothesis)
            )
            moved, seen, many = None, self.point.seen, shape[0] * shape[1]
            if self.fit.problem.data.material or not self.fit.forward.instantaneous:
                rows = self.fit.whitener(collected(self.now, s, parts, many), own=True)
            else:
                moved = np.zeros((many, *seen.shape))
                for frames, dx in parts:
                    moved[:, frames] = dx
                rows = self.fit.whitener(self._at_stations(moved))
        values = rows.reshape(len(rows), *shape)
        return Sensitivity(hypothesis, values, self.fit.whitener, seen, moved)

    def _whitened_anew(self, known: Sensitivity) -> np.ndarray:
        """Return (M D, P) known changes, whitened with this fit's noise."""
        if known.moved is not None:
            return self.fit.whitener(self._at_stations(known.moved))
        rows, shape = known.values.reshape(len(known.values), -1), self.fit.stations.residual.shape
        if known.whitener is self.fit.whitener:
            return rows
        return self.fit.whitener(known.whitener.undo(rows).reshape(*shape, -1))

    def _at_stations(self, dx: np.ndarray) -> np.ndarray:
        """Return (M, D, P) [m] what changes dx (P, F, K, 3) [m] of the nodes change there."""
        return aligned(self.now, self.fit.stations, self.now.project(dx))

    def _alike(self, hypothesis: Hypothesis, known: Sensitivity) -> bool:
        """Return whether the rope responds as it is known to."""
        places, seen = known.hypothesis.places, known.seen
        if places.shape != hypothesis.places.shape or seen.shape != self.point.seen.shape:
            return False
        length = float(self.setup.properties.length.sum())
        if (np.abs(places - hypothesis.places) >= ALIKE_SHAPES * length).any():
            return False
        if known.moved is None and len(known.values) != self.fit.stations.residual.size:
            return False
        if self.fit.forward.instantaneous:
            return bool((np.abs(seen - self.point.seen) < ALIKE_SHAPES * length).all())
        stations = self.fit.stations
        if self.earlier is None or self.earlier[0] is not seen:  # a scan shares one
            self.earlier = seen, self.fit.problem.match(np.nan_to_num(seen)).residual
        apart = self.earlier[1] - self.now.residual
        missed = np.linalg.norm(stations.residual)
        return apart.shape == stations.residual.shape and bool(
            np.linalg.norm(apart) < NEAR_IN_MOTION * missed
        )

    def _nodes(self, hypothesis: Hypothesis) -> Parts:
        """Return frames and the changes of the nodes there (Q k, f, K, 3) [m], until all are."""
        if self.fit.forward.instantaneous and self._is_load(hypothesis):
            many = len(hypothesis.places) * hypothesis.size
            return self.point.by_loads(many, lambda index: self._loads(hypothesis, index))
        if hypothesis.effect.turns_rope and self._spins_freely():
            return self._tangents(hypothesis, turned=True)
        if hypothesis.effect.tangent:
            return self._tangents(hypothesis)
        return iter([(np.arange(len(self.point.seen)), self._finite_responses(hypothesis))])

    def _spins_freely(self) -> bool:
        """Return whether the rope may spin at no cost, or nearly, where its bends have a memory: it
        is straight without loads."""
        straight = bool(np.abs(self.point.solution.rod.rest).max() < STRAIGHT)
        return self.fit.forward.instantaneous and straight

    def _tangents(self, hypothesis: Hypothesis, turned: bool = False) -> Parts:
        zero = np.zeros(hypothesis.size)
        terms = [
            hypothesis.term_at(self.setup, np.concatenate([zero, place]))
            for place in hypothesis.places
        ]
        if hypothesis.effect.path_dependent:
            start = np.zeros(sum(term.size for term in terms))
            model = self.fit.forward.of_setup(self.setup, self.point.solution, terms)
            model.remember(self.point)  # at zero size the rope is where it is
            return model.at(start).parts(model.changes(start))
        changes = [change_by(self.setup, term, k) for term in terms for k in range(term.size)]
        return self.point.parts(changes, turned)

    def _finite_responses(self, hypothesis: Hypothesis) -> np.ndarray:
        scales, out = hypothesis.scales(self.setup), []
        for place in hypothesis.places:
            for k in range(hypothesis.size):
                values = np.zeros(hypothesis.size)
                values[k] = PROBE * scales[k]
                changed = self.response(hypothesis, np.concatenate([values, place]))
                out.append((changed - self.point.seen) / PROBE)
        return np.stack(out)

    def response(self, hypothesis: Hypothesis, values: np.ndarray) -> np.ndarray:
        """Return (F, K, 3) nodes as seen with the effect at values (k + p,), NaN if unsettled."""
        setup = self.setup.after(lambda s: hypothesis.effect.apply(s, values))
        return self.fit.forward.of_setup(setup, self.point.solution).at(np.empty(0)).seen

    def _is_load(self, hypothesis: Hypothesis) -> bool:
        """Return whether an effect is a load on the nodes in proportion to its sizes."""
        one = self.point.solution.x[:1], hypothesis.places[0]
        return hypothesis.effect.unit_loads(self.setup, *one) is not None

    def _loads(self, hypothesis: Hypothesis, index: np.ndarray) -> np.ndarray:
        """Return (f, Q k, K, 3) [N] on the nodes in some frames per usual size."""
        x, effect = self.point.solution.x[index], hypothesis.effect
        loads = [effect.unit_loads(self.setup, x, place) for place in hypothesis.places]
        load = np.stack([one for one in loads if one is not None], axis=1)
        load *= hypothesis.scales(self.setup)[:, None, None]
        return load.reshape(len(x), -1, x.shape[1], 3)
