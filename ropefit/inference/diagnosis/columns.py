"""Whitened responses of all stations to every effect at every place, without refit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from ropefit.effects.place import at_point, middle_of
from ropefit.inference.diagnosis.families import Family
from ropefit.inference.forward import Forward, change_by
from ropefit.inference.least_squares import Fit, sensitivity
from ropefit.inference.response import Point
from ropefit.inference.stations import Data, match
from ropefit.solvers.equilibrium.implicit import Directions, tangent

PROBE = 0.3  # of its usual size: where an effect is tried that has no derivative at zero


@dataclass(frozen=True)
class Columns:
    """Of one family: values (M D, Q, k), responses to quantities of their usual size."""

    family: Family
    values: np.ndarray


class Responses:
    """Computes columns at a fit's point; what they share is computed once."""

    def __init__(self, fit: Fit, data: Data, bins: int) -> None:
        self.fit, self.point = fit, fit.point
        self.now = match(data, np.where(np.isfinite(fit.point.seen), fit.point.seen, 0.0), bins)
        self.setup = fit.point.setup

    def whiten(self, dx: np.ndarray) -> np.ndarray:
        """(M D, P) of changes dx (P, F, K, 3) of the nodes."""
        return sensitivity(np.nan_to_num(dx), self.now, self.fit.stations, self.fit.whitener)

    def of(self, family: Family) -> Columns:
        """The family's columns, in units of the usual sizes."""
        if family.name == "tether":
            dx = self._tether(family)
        elif family.effect.linear and family.name != "clamped_end":
            dx = self._derivatives(family)
        else:
            dx = self._differences(family)
        rows = self.whiten(dx)
        return Columns(family, rows.reshape(len(rows), len(family.places), family.size))

    def _derivatives(self, family: Family) -> np.ndarray:
        zero = np.zeros(family.size)
        terms = [
            family.term(self.setup, np.concatenate([zero, place]), free_place=False)
            for place in family.places
        ]
        point = self.point
        if family.name == "contact_friction":  # its slope at zero is along the way that was gone
            point = Forward(self.setup, terms, point.solution).at(np.zeros(1))
        return point.respond(
            [change_by(self.setup, term, k) for term in terms for k in range(term.size)]
        )

    def _differences(self, family: Family) -> np.ndarray:
        scales, out = family.scales(self.setup), []
        for place in family.places:
            for k in range(family.size):
                values = np.zeros(family.size)
                values[k] = PROBE * scales[k]
                changed = self.response(family, np.concatenate([values, place]))
                out.append((changed - self.point.seen) / PROBE)
        return np.stack(out)

    def response(self, family: Family, values: np.ndarray) -> np.ndarray:
        """(F, K, 3) nodes as seen with the effect at values (k + p,); NaN where unsettled."""
        setup = self.setup.after(lambda s: family.effect.apply(s, torch.from_numpy(values)))
        return Forward(setup, [], self.point.solution).at(np.empty(0)).seen

    def _tether(self, family: Family) -> np.ndarray:
        """The force k (anchor - x) on the place, per unit of k and of k anchor."""
        x = self.point.solution.x
        arc, middle = self.setup.arc.detach(), middle_of(self.setup).numpy()
        frames = len(x)
        load = np.zeros((frames, len(family.places), 4, x.shape[1], 3))
        for i, place in enumerate(family.places):
            share = at_point(arc, torch.tensor(place[0])).numpy()
            arm = np.einsum("k,fka->fa", share, x) - middle
            load[:, i, 0] = -share[None, :, None] * arm[:, None, :]
            for a in range(3):
                load[:, i, 1 + a, :, a] = share
        load = (load * family.scales(self.setup)[:, None, None]).reshape(frames, -1, x.shape[1], 3)
        return loads_to_nodes(self.point, load)


def loads_to_nodes(point: Point, load: np.ndarray) -> np.ndarray:
    """(P, F, K, 3) [m] changes of the nodes for loads (F, P, K, 3) [N] on them."""
    dx, _ = tangent(point.solution, Directions(load=load))
    return np.moveaxis(dx, 1, 0)
