"""The noise of a recording, measured beside what effects explain, before the search begins."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ropefit.diagnosis.beginning import first_order_move
from ropefit.diagnosis.candidate import Candidate, cost_for, fit_candidate
from ropefit.diagnosis.candidates import fit_candidates
from ropefit.diagnosis.coarse_mesh import on_coarse_mesh
from ropefit.diagnosis.companions import Companions, companions
from ropefit.diagnosis.full_scan import Scan, sensitivities
from ropefit.diagnosis.hypotheses import made_possible
from ropefit.diagnosis.noise_measurement import measured_noise
from ropefit.diagnosis.proposals import proposals, uneven
from ropefit.diagnosis.quick_fits import alike, quick_ones, unknown_frames
from ropefit.diagnosis.rules import Rules
from ropefit.diagnosis.sensitivities import Sensitivity
from ropefit.diagnosis.unexplained import explained, unexplained
from ropefit.diagnosis.wander import (
    no_larger_than_left,
    wandering_noise,
    with_what_is_missed_alike,
)
from ropefit.inference.least_squares import Fit, attempted, fit
from ropefit.inference.noise import Noise


class Prepared(NamedTuple):
    """The nominal model, fitted with the measured noise; of the nominal model before that, what
    was computed for the noise: its sensitivities, and fits of what no scan shows, one after the
    other and two at once."""

    nominal: Fit
    sensitivities: list[Sensitivity]
    candidates: list[Candidate]
    together: Companions | None = None


class FirstNoise(NamedTuple):
    """Noise, and what was computed for it; see `Prepared`."""

    noise: Noise
    sensitivities: list[Sensitivity]
    candidates: list[Candidate]
    together: Companions | None = None


def prepared(nominal: Fit, rules: Rules) -> Prepared:
    """Measure the noise and fit the nominal model with it."""
    problem = nominal.problem.settled(nominal.point.seen)
    if not problem.data.material:  # one white noise for all fits, as at the nominal one
        seen = problem.match(nominal.point.seen).scatter[0]
        problem = problem.under(replace(problem.noise, white=tuple(float(v) for v in seen)))
        nominal = fit(nominal.forward, problem, nominal.point.u, 5, tolerance=1e-5)
    noise, known, candidates, together = first_noise(nominal, rules)
    if together is not None:  # without frames in which they act by what was before
        nominal, problem = together.smaller, together.smaller.problem
    if nominal.forward.instantaneous and known:
        noise = with_what_is_missed_alike(noise, nominal, known)
        noise = no_larger_than_left(noise, nominal, known)
    forward = nominal.forward.starting_from(nominal.point.solution)
    again = fit(forward, problem.under(noise), nominal.point.u, 20, tolerance=1e-5)
    return Prepared(again, known, candidates, together)


def first_noise(nominal: Fit, rules: Rules) -> FirstNoise:
    """Measure the noise beside what effects explain; with the sensitivities of the nominal model
    and the fits that were made for that.

    Effects that no scan shows to the full (contact, path dependence) are fitted: otherwise they
    would be taken for noise of the ends, and then for nothing. Nor can noise be measured against a
    rope at rest that is in motion.
    """
    noise = nominal.problem.noise
    if not nominal.forward.instantaneous:
        steady = sensitivities(nominal, [], rules.effects)
        return FirstNoise(wandering_noise(nominal, steady), steady, [])
    if rules.noise == "white":
        return FirstNoise(replace(noise, correlated=0.0, ends=None), [], [])
    at_rest, quick = nominal, quick_ones(nominal, rules.least_evidence, rules.effects)
    nominal = quick[-1].fit if quick else nominal
    steady = sensitivities(nominal, [], rules.effects)
    known = steady if nominal is at_rest else []
    measured, cost = measured_noise(nominal, steady, [])
    if not measured.coloured:
        return FirstNoise(measured, known, quick)
    scan = Scan(nominal, lambda: steady)
    if scan.scores[0].score > rules.scan_explains * unexplained(nominal):
        return FirstNoise(measured, known, quick)
    leader = _of_whole_rope(nominal, scan, rules.least_evidence)
    whole = leader and _by_whole_rope(nominal, leader, rules)
    if whole is not None:
        measured, _ = measured_noise(nominal, steady, [whole[1]])
        return FirstNoise(measured, known, quick + whole[0])
    # For the noise, the best place of each is enough.
    hidden = [replace(s, second=None) for s in scan.scores if s.hypothesis.effect.looks_like_noise]
    least, quick_starts = rules.least_evidence, []
    if leader is not None:  # fitted already: it goes on from its end, or is without prospect
        hidden = [s for s in hidden if s.hypothesis is not leader.hypothesis]
        if leader.hypothesis.effect.looks_like_noise and leader.evidence > least:
            quick_starts = [[(leader.hypothesis, leader.values())]]
    slow, late = [], []
    for choices in scan.contact(rules):
        (late if choices[0][0].effect.late else slow).append(choices)
    coarse = on_coarse_mesh(nominal)
    candidates = fit_candidates(
        coarse, hidden, quick_starts, slow, least, rules.effects, for_noise=True
    )
    candidates = [c for c in candidates if c.evidence > least]
    if nominal is at_rest and rules.most_effects > 1:
        best = candidates[0].fit if candidates else nominal
        if _far_off(best) and (not explained(nominal, best) or uneven(best)):
            together = companions(nominal, slow, rules.effects)
            if together is not None:
                return _beside_both(together, steady, candidates, rules)
    seen = nominal.stations.residual
    moves = [seen - c.fit.stations.residual for c in candidates]
    moves += _beside(nominal, candidates, rules)
    if moves:
        measured, cost = measured_noise(nominal, steady, moves)
    if not candidates or not explained(nominal, candidates[0].fit):
        # Nor need laws of place be fitted for it: where their starts move the rope is enough.
        further = []
        for choices in late:
            tried = (first_order_move(nominal, *start) for start in choices)
            further += [move for move in tried if move is not None][:1]
        if further:
            # Started where most of the misfit points to, they gain by noise of the ends, too.
            beside, left = measured_noise(nominal, steady, moves + further)
            measured = beside if left < cost - rules.least_evidence else measured
    return FirstNoise(measured, known, quick + candidates)


def _of_whole_rope(nominal: Fit, scan: Scan, least_evidence: float) -> Candidate | None:
    """Return the first effect of a scan that acts on the whole rope, fitted as long as it may have
    some evidence; None if there is none, or it does not settle."""
    first = next((s for s in scan.scores if s.hypothesis.effect.locus == "whole"), None)
    if first is None:
        return None
    start, needed = np.concatenate(first.starts()[0]), cost_for(nominal, least_evidence)
    return fit_candidate(nominal, first.hypothesis, start, needed=needed)


def _by_whole_rope(
    nominal: Fit, found: Candidate, rules: Rules
) -> tuple[list[Candidate], np.ndarray] | None:
    """Return an effect that acts on the whole rope, and quick ones on top of it, with what they do
    to the stations (M, D) [m], if they explain all frames alike (a lag, or a rope that is slowed,
    once fitted): nothing else need then be fitted for the noise."""
    if found.evidence <= rules.least_evidence:
        return None
    left, smaller = found.fit.stations.residual.copy(), nominal
    lost = unknown_frames(found)
    if lost.any():  # at the frames of which what is left is not known
        without = nominal.problem.without(lost)
        smaller = attempted(nominal.forward, without, nominal.point.u, 20, 1e-5)
        again = smaller and fit_candidate(smaller, found.hypothesis, found.values())
        if smaller is None or again is None:
            return None
        found = again
    out = [found, *quick_ones(found.fit, rules.least_evidence, rules.effects)]
    last = out[-1].fit
    kept = ~lost[nominal.stations.frame]
    if kept.sum() != len(last.stations.frame) or not (explained(smaller, last) and alike(last)):
        return None
    left[kept] = last.stations.residual
    return out, nominal.stations.residual - left


def _far_off(fitted: Fit) -> bool:
    """Return whether a fit leaves more than noise does: only then are two effects fitted at once,
    as what is left of one, if it is that little, does not hinder its own fit."""
    return unexplained(fitted) > len(fitted.z)


def _beside_both(
    together: Companions, known: list[Sensitivity], candidates: list[Candidate], rules: Rules
) -> FirstNoise:
    """Return the noise as measured beside two effects at once."""
    without = together.smaller
    steady = sensitivities(without, [], rules.effects, known)
    moves = [without.stations.residual - together.fit.stations.residual]
    measured, _ = measured_noise(without, steady, moves)
    return FirstNoise(measured, steady, candidates, together)


def _beside(nominal: Fit, candidates: list[Candidate], rules: Rules) -> list[np.ndarray]:
    """Return (M, D) [m] each, what effects do to the stations, to first order, that can occur only
    beside one of the candidates: what is touched may also be rough."""
    out: list[np.ndarray] = []
    for candidate in candidates:
        setup = candidate.fit.point.setup
        every = made_possible(setup, nominal.point.setup, rules.effects)
        further = tuple(effect.name for effect in every)
        for choices in proposals(candidate.fit, slow=True, names=further) if further else []:
            tried = (first_order_move(candidate.fit, *start) for start in choices)
            out += [move for move in tried if move is not None][:1]
    return out
