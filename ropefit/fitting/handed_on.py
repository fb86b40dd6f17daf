"""The rope as its own recording knows it: values that are known together, with their covariance.

That recording tells rigidity, rest curve, sections and offsets of markers better together than each
by itself: a softer rope hangs as before if it is also curved more. As independent priors they allow
what that recording excludes, as a weight of half its size on a softer rope.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from ropefit.diagnosis.candidate import columns_of
from ropefit.inference.bins import Data
from ropefit.inference.least_squares import Fit
from ropefit.models.correlated import Correlated
from ropefit.models.prior import Joint, Prior
from ropefit.models.terms import Term

HANDLING_SD = 0.05  # of the logarithm of a rigidity: what handling changes between two recordings
# Times what was known: a prior from the same recording, which its data tell once more.
LOOSER = 10.0
SAME_PLACE = 3  # digits of the share of the length
TWISTING = "GJ"  # next to unseen where no end is turned: its prior is no such one
RIGIDITIES = ("EI", TWISTING)


def known_together(own: list[Term], control: Fit) -> list[Term]:
    """Return the rope's own terms with the values and the joint covariance that they have in the
    fit of its own recording; those that it has not, as they are."""
    there = _numbered(control.forward.terms)
    both = [(term, there[key]) for key, term in _numbered(own).items() if key in there]
    if not both:
        return own
    columns = columns_of(control, *(other for _, other in both))
    turn = block_diag(*(_in_variables_of(term, other) for term, other in both))
    covariance = _by_data(control, [other for _, other in both])[np.ix_(columns, columns)]
    handled = np.concatenate([np.full(t.size, t.name in RIGIDITIES) for t, _ in both])
    joint = Joint(turn @ covariance @ turn.T + np.diag(HANDLING_SD**2 * handled))
    u, first, known = turn @ control.point.u[columns], 0, {}
    for term, _ in both:
        known[id(term)] = _known(term, u[first : first + term.size], joint, first)
        first += term.size
    return [known.get(id(term), term) for term in own]


def same_markers(here: Data, there: Data) -> bool:
    """Return whether two recordings have the same markers, by their places along the rope."""
    mine, theirs = (np.unique(np.round(d.share[d.mask], SAME_PLACE)) for d in (here, there))
    return np.array_equal(mine, theirs)


def _numbered(terms: list[Term]) -> dict[tuple[str, int, int], Term]:
    """Return the terms by their names, their sizes, and how many of both came before."""
    count: Counter[tuple[str, int]] = Counter()
    out = {}
    for term in terms:
        kind = term.name, term.size
        out[*kind, count[kind]] = term
        count[kind] += 1
    return out


def _in_variables_of(here: Term, there: Term) -> np.ndarray:
    """Return (n, n) search variables of a term per those of the same one elsewhere."""
    if isinstance(here, Correlated) and isinstance(there, Correlated):
        return np.linalg.solve(here.root, there.root)
    return np.eye(here.size)


def _by_data(control: Fit, told: list[Term]) -> np.ndarray:
    """Return the covariance (P, P) of a fit by its data and the errors of its own set-up: what was
    known of the rope, in the terms `told`, is from the same data."""
    same = [term for term in told if not (term.nuisance or term.name == TWISTING)]
    sd = control.prior.sd.copy()
    sd[columns_of(control, *same)] *= LOOSER
    return replace(control, prior=Prior(sd)).covariance


def _known(term: Term, u: np.ndarray, joint: Joint, first: int) -> Term:
    """Return a term that starts at search variables u (n,), which are known together with others,
    its own from the place `first` on."""
    sd = np.sqrt(np.diag(joint.covariance))[first : first + term.size]
    return replace(term, start=term.value(u), prior=sd * term.scale, joint=(joint, first))
