"""The diagnosis: accept one effect at a time, until what is left is noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from ropefit.diagnosis.acceptance import (
    far_beyond_sensor,
)
from ropefit.diagnosis.accepted import Accepted, accept
from ropefit.diagnosis.alternatives import Alternative, alternatives
from ropefit.diagnosis.beside_leader import with_noise_beside_leader
from ropefit.diagnosis.branch_repair import on_right_branches
from ropefit.diagnosis.candidate import Candidate, best_of, recompared
from ropefit.diagnosis.candidates import completed, started_from, unfinished
from ropefit.diagnosis.companions import accepted_companions
from ropefit.diagnosis.confounding import confounded
from ropefit.diagnosis.contact_anew import contact_anew
from ropefit.diagnosis.contact_beside import ContactBeside, by_contact
from ropefit.diagnosis.equivalence import TIE_NATS
from ropefit.diagnosis.fewer_frames import FoundBefore, known_again, pair_again
from ropefit.diagnosis.first_noise import prepared
from ropefit.diagnosis.fits import Progress
from ropefit.diagnosis.full_scan import Scan, sensitivities
from ropefit.diagnosis.known_rope import from_known_rope
from ropefit.diagnosis.last_fit import last_fit
from ropefit.diagnosis.latent_force import LatentForce
from ropefit.diagnosis.limits import clean_limits
from ropefit.diagnosis.mixed_pairs import beside_contact, two_instead
from ropefit.diagnosis.open_places import HeldPlace, held_places
from ropefit.diagnosis.own_motion import with_own_motion
from ropefit.diagnosis.pairs import Pair, accepted_pair, as_points, best_pair, together
from ropefit.diagnosis.proposals import proposals
from ropefit.diagnosis.reassessment import reassessed, without_insignificant
from ropefit.diagnosis.rules import RULES, Rules
from ropefit.diagnosis.scan import Score
from ropefit.diagnosis.short_horizons import by_short_horizons
from ropefit.diagnosis.unexplained import may_lack_more, unexplained
from ropefit.diagnosis.verdicts import one_more, verdict_of
from ropefit.diagnosis.with_accepted import with_both, with_it, with_known_past
from ropefit.inference.least_squares import Fit

MORE_ROUNDS = 4  # than effects: a restart, contact anew, one uncounted, one that sees what is left
ENDED = (
    "further candidates: not fitted after {} evaluations of the model (--evaluations allows more)"
)
NEARLY_ALL = 0.01  # of the misfit, left by two effects at once: no single one comes near


@dataclass
class Diagnosis:
    """verdict; accepted effects; the nominal fit and the last; scans; thresholds; latent force;
    of_known: candidates beside the rope as it is known from elsewhere."""

    verdict: str
    accepted: list[Accepted]
    nominal: Fit
    final: Fit
    scan: list[Score]
    threshold: float
    latent: LatentForce
    detectable: dict[str, float]
    units: dict[str, str]
    refused: list[str] = field(default_factory=list)
    of_known: list[Candidate] = field(default_factory=list)

    @cached_property
    def alternatives(self) -> list[Alternative]:
        """Return what else may stand in the place of one effect, beside the others."""
        return alternatives(self.final, self.accepted, self.threshold)

    @cached_property
    def held_places(self) -> list[HeldPlace]:
        """Return the fits with a place that is open held elsewhere."""
        return held_places(self.final, self.accepted)


def _share(rounds: float) -> float:
    """Return the share reported as done after some rounds: each is taken to be as long as all that
    may follow it, as their number is unknown."""
    return 1 - 0.9 * 0.5**rounds


def _fits_of_round(progress: Progress, round_: int) -> Progress:
    """Return where the fits of a round report which one is under way."""
    return lambda share, text: progress(
        _share(round_ + 0.1 + 0.8 * share), f"round {round_ + 1}: {text}"
    )


def search(
    nominal: Fit, seed: int, progress: Progress, rules: Rules = RULES,
    before: FoundBefore | None = None,
) -> Diagnosis:  # fmt: skip
    """Diagnose a recording, from a nominal fit with white noise, and what was found before with
    more frames."""
    rng = np.random.default_rng(seed)
    nominal = on_right_branches(nominal)
    every = nominal.problem.data
    progress(0.05, "noise")
    nominal, known, fitted, both = prepared(nominal, rules)
    current, accepted, refused = nominal, [], []
    scores, limits, scan, crowded, most = None, None, None, False, rules.most_effects
    singles: list[Candidate] = []
    compared: list[Accepted] | None = None  # two effects that were, with every pair
    alone: Accepted | None = None  # a single effect that was compared with every pair
    contact = ContactBeside()
    leader: list[Candidate] = []  # of the round before, where that restarted the model
    from_known: list[Candidate] = []
    of_known: list[Candidate] = []  # the same, of the first round
    with current.problem.work.limited() as work:
        for round_ in range(rules.most_effects + MORE_ROUNDS):
            work.most = rules.most_beside(accepted)
            progress(_share(round_), f"round {round_ + 1}: scan")
            scan = None  # it is large: one at a time
            scan = Scan(current, partial(sensitivities, current, accepted, rules.effects, known))
            known = []  # of the nominal model
            if scores is None or limits is None:
                scores, limits = scan.scores, clean_limits(scan, rng, rules)
                refused += confounded(current, scan.sensitivities)
            scan.latent.threshold, latent = limits.latent, scan.latent
            inexact = [one for one in accepted if not one.candidate.hypothesis.effect.exact]
            needed = limits.needed(inexact)
            anew = scan.anything(rules) and contact_anew(current, accepted, limits.threshold)
            if anew:
                current, accepted, compared = _weighed_again(
                    *anew, limits.threshold, len(scan.scores), rules, singles
                )
                continue
            instead = partial(two_instead, threshold=limits.threshold, rules=rules)
            if len(accepted) == most:
                crowded, two = one_more(nominal, accepted, scan, limits), accepted
                left = crowded or latent.evidence > latent.threshold
                new = two is not compared and current.forward.instantaneous
                if left and new and len(two) == 2:
                    current, accepted = instead(current, two, singles=singles)
                    compared = accepted
                if accepted is two:
                    break
                continue
            quick = started_from(fitted, proposals(current, slow=False, names=rules.effects))
            quick += beside_contact(accepted, singles)
            singles_of = partial(
                rules.selection.candidates, current, scan.scores, quick, threshold=needed,
                names=rules.effects, progress=_fits_of_round(progress, round_),
            )  # fmt: skip
            pair = accepted_companions(current, both, limits.threshold) if both else None
            both = None  # if they are not accepted, what is slow is a candidate as ever
            if pair is not None and _wins(pair, current, singles_of):
                accepted, current = with_both(current, every, pair, scan)
                continue
            slow = started_from(fitted, scan.contact(rules, needed))
            begun = contact.on(current) if slow else []
            if leader:
                from_known = recompared(from_known, current)
            elif accepted:
                from_known = []
            elif before:
                from_known = known_again(current, before)
            else:
                from_known = from_known_rope(current, needed, rules.effects)
            of_known = from_known or of_known
            again = before and pair_again(current, before, from_known, needed, len(scan.scores))
            before = None
            if again:
                current, accepted = with_it(again[0], current.problem, scan.sensitivities), again[1]
                compared = accepted  # with every pair, where there were more frames
                continue
            fits = singles_of(slow=slow, known=[*begun, *from_known])
            candidates = best_of([*fits, *leader])
            leader = []
            singles = singles if accepted else candidates
            progress(_share(round_ + 0.9), f"round {round_ + 1}: tests on held-out frames")
            fitted = []  # to the nominal model
            if far_beyond_sensor(current):
                current, candidates = _in_motion(current, candidates, scan, limits.threshold)
            if candidates and candidates[0].evidence >= needed:
                again = rules.selection.restarted(current, candidates[0], rules.restart_share)
                if again is not None:  # about which the scan may not show the leader any more
                    current, leader = again, recompared(candidates[:1], again)
                    continue
            candidates, best, pair = *_acceptable(current, candidates, needed, rules, refused), None
            there = bool(candidates) and candidates[0].evidence >= needed
            if there and not accepted and most > 1 and current.forward.instantaneous:
                pair = best_pair(current, scan.sensitivities, best, limits.threshold)
            if pair is not None:
                # Two effects of one kind may stand for two of different kinds and leave only noise.
                accepted, current = accepted_pair(pair, len(scan.sensitivities))
                current, accepted = instead(current, accepted, singles=singles)
                compared = accepted
                continue
            left = there or latent.evidence > latent.threshold
            if accepted:
                as_elsewhere = current.problem.noise.misfit and not _is_left(current)
                left = left and accepted[0] is not alone and not as_elsewhere
            if (
                best is None
                and left
                and len(accepted) < 2 <= most
                and current.forward.instantaneous
            ):
                one = accepted
                current, accepted = instead(current, one, singles=singles)
                if accepted is not one:
                    compared = accepted
                    continue
            if best is None:
                break
            newest = accept(best, candidates, current, len(scan.sensitivities))
            best = newest.candidate
            most += not best.hypothesis.effect.counted
            every = with_known_past(every, current, best)
            problem = replace(current.problem, data=every.settled(best.fit.point.seen))
            current = with_it(best.fit, problem, scan.sensitivities)
            accepted = [*accepted, newest]
            if len(accepted) == 1 < most and _is_left(current):
                # It may stand for two: pairs are compared before a second is looked for beside it,
                # unless contact leaves nothing that they could explain better.
                one, contact = accepted, by_contact(current, limits.threshold, rules.effects)
                if not (contact.explains or best.hypothesis.effect.slow):
                    current, accepted = instead(
                        current, one, singles=singles, contact=contact.evidence
                    )
                    singles, alone = [], None if contact.evidence else accepted[0]
                if accepted is not one:
                    compared = accepted
                    continue
            current, accepted, compared = _weighed_again(
                current, accepted, limits.threshold, len(scan.sensitivities), rules, singles, alone
            )
    progress(0.98, "intervals, and what a next motion would show")
    assert scores is not None
    assert limits is not None
    if current.problem.work.exhausted:
        refused.append(ENDED.format(current.problem.work.evaluations))
    if accepted:
        current, accepted = without_insignificant(last_fit(current), accepted, limits.threshold)
        current = with_own_motion(current)
    verdict = verdict_of(nominal, current, accepted, latent, crowded, refused)
    return Diagnosis(
        verdict, accepted, nominal, current, scores,
        limits.threshold, latent, limits.detectable, limits.units, refused, of_known,
    )  # fmt: skip


def _is_left(current: Fit) -> bool:
    """Return whether a rope at rest leaves more than noise, and more than elsewhere."""
    return current.forward.instantaneous and may_lack_more(current)


def _weighed_again(
    current: Fit, accepted: list[Accepted], threshold: float, tried: int, rules: Rules,
    singles: list[Candidate], alone: Accepted | None = None,
) -> tuple[Fit, list[Accepted], list[Accepted] | None]:  # fmt: skip
    """Return the fit and the accepted effects, each weighed again beside the newest; again these,
    if they are two that were compared with every pair, also beside the `singles` if there are any.
    alone: the one of which that is known: no pair that is not better than it by itself is better
    than it with another."""
    current, accepted = reassessed(current, accepted, threshold, tried, rules.effects)
    current, accepted = as_points(current, accepted, threshold)
    if len(accepted) != 2 or not current.forward.instantaneous:
        return current, accepted, None
    left = may_lack_more(current)
    if left and alone and alone.candidate.hypothesis.key == accepted[0].candidate.hypothesis.key:
        return current, accepted, accepted
    current, accepted = two_instead(current, accepted, threshold, rules, singles if left else ())
    return current, accepted, accepted if left or not singles else None


def _in_motion(
    current: Fit, candidates: list[Candidate], scan: Scan, threshold: float
) -> tuple[Fit, list[Candidate]]:
    """Return a model that misses a motion by far, with the noise beside its best candidate, and the
    candidates: where the best explains too little, also those that short predictions show."""
    if not candidates or far_beyond_sensor(candidates[0].fit):
        scanned = [s.hypothesis for s in scan.sensitivities]
        near = by_short_horizons(current, scanned, threshold)
        candidates = best_of([*candidates, *near])
    return with_noise_beside_leader(current, candidates, threshold)


def _acceptable(
    current: Fit, candidates: list[Candidate], needed: float, rules: Rules, refused: list[str]
) -> tuple[list[Candidate], Candidate | None]:
    """Return the candidates and the one that is accepted, if any; why others are not goes to
    `refused`. Where the leader is not, those that are unfinished may be fitted to the end."""
    refusals: list[str] = []
    candidates = rules.selection.supported(candidates, needed, current, refused)
    best = rules.selection.acceptable(candidates, needed, current, refusals)
    if refusals and any(map(unfinished, candidates)):
        accepts = partial(rules.selection.acceptable, threshold=needed, current=current, refused=[])
        candidates, refusals = completed(current, candidates, needed, accepts), []
        best = rules.selection.acceptable(candidates, needed, current, refusals)
    refused += refusals
    return candidates, best


def _wins(pair: Pair, current: Fit, singles_of: Callable[..., list[Candidate]]) -> bool:
    """Return whether two effects that were found at once are better than any single one of those
    that are fitted quickly; not asked where they leave so little that none can be."""
    if unexplained(pair[1]) <= NEARLY_ALL * unexplained(current):
        return True
    singles = singles_of(slow=[])
    return not singles or together(current, pair[1]) > singles[0].evidence + TIE_NATS
