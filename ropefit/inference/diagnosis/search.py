"""The diagnosis: one effect at a time, until what is left is noise (DIAGNOSIS, section 5)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ropefit.effects import ContactFriction, Inertia
from ropefit.inference.bins import Data, match
from ropefit.inference.diagnosis.absorbed import absorbed
from ropefit.inference.diagnosis.background import measure
from ropefit.inference.diagnosis.columns import Columns, Responses
from ropefit.inference.diagnosis.contact import Start, proposals, uneven
from ropefit.inference.diagnosis.evidence import Projection, Scored, Scorer, null_residuals
from ropefit.inference.diagnosis.families import families
from ropefit.inference.diagnosis.found import Found, found
from ropefit.inference.diagnosis.gates import winner_of
from ropefit.inference.diagnosis.in_motion import inertial
from ropefit.inference.diagnosis.latent import Latent, latent_force
from ropefit.inference.diagnosis.reconsider import reconsidered
from ropefit.inference.diagnosis.rivals import NEGLIGIBLE, fit_rivals, key_of, repair, unexplained
from ropefit.inference.diagnosis.weigh import Rival, fit_rival
from ropefit.inference.least_squares import Fit, attempted, fit
from ropefit.inference.noise import Noise
from ropefit.models.equilibrium import Forward

LEAST = 6.0  # nats: on less no effect is believed; at 5 one clean recording in a hundred had one
MARGIN = 10.0  # nats over a clean recording's 99 % that make a latent force real
REPLICATES = 100
ANYTHING = 2.0  # nats
STUCK = 0.2  # of a winner's evidence: gained without it, by beginning elsewhere
MOST_EFFECTS = 2  # more would explain anything: then it is unknown
SHOWN = 0.7  # of the misfit: what a scan explains of it in one place
IN_MOTION = 0.5  # of the first misfit: what may stay once inertia is found


@dataclass
class Diagnosis:
    """verdict; accepted effects; the nominal fit and the last; scans; thresholds; latent force."""

    verdict: str
    found: list[Found]
    nominal: Fit
    final: Fit
    noise: Noise
    scan: list[Scored]
    threshold: float
    latent: Latent
    detectable: dict[str, float]
    units: dict[str, str]
    refused: list[str] = field(default_factory=list)


Progress = Callable[[float, str], None]


def search(
    nominal: Fit, data: Data, noise: Noise, bins: int, seed: int, progress: Progress
) -> Diagnosis:
    """Run the whole diagnosis from a nominal fit with white noise."""
    rng = np.random.default_rng(seed)
    nominal = repair(nominal, data, noise, bins)
    every, data = data, data.settled(nominal.point.seen)
    progress(0.1, "scan")
    if not data.material:  # one white noise for all fits, seen at the nominal one
        seen = match(data, nominal.point.seen, bins).scatter[0]
        noise = replace(noise, white=tuple(float(v) for v in seen))
        nominal = fit(nominal.forward, data, noise, bins, nominal.point.u, 5, tolerance=1e-5)
    noise = _noise(nominal, data, noise, bins)
    start = nominal.forward
    start.last = nominal.point.solution
    nominal = fit(start, data, noise, bins, nominal.point.u, 20, tolerance=1e-5)
    current, accepted, refused = nominal, [], []
    threshold, clean, first_scan, detectable, units = LEAST, 0.0, [], {}, {}
    latent, crowded, most = None, False, MOST_EFFECTS
    for round_ in range(MOST_EFFECTS + 3):  # of which one may begin anew, and one see what is left
        progress(0.2 + 0.16 * round_, "scan")
        columns = _columns(current, data, bins, accepted)
        project = Projection(current)
        setup = current.point.setup
        scorers = [Scorer(c, project, c.family.scales(setup)) for c in columns]
        scored: list[Scored] = [score(project.z) for score in scorers]
        scan = sorted(scored, key=lambda s: -s.log_factor)
        latent = latent_force(current, project)
        if round_ == 0:
            null = null_residuals(current, project, REPLICATES, rng)
            highest = np.max([s.family_factor(null) for s in scorers], axis=0)
            # The upper end of a Gumbel law through the replicates.
            spread = np.sqrt(6) / np.pi * highest.std()
            threshold = max(LEAST, float(highest.mean() + spread * (-np.log(0.01) - 0.5772)))
            clean = float(np.quantile(latent.null(null), 0.99)) + MARGIN
            first_scan = scan
            refused += absorbed(current, columns)
            for s in scorers:
                size, of = s.detectable(threshold), s.family.effect.quantities[0]
                if size < of.upper:  # larger there is none: such a recording cannot show it
                    detectable[s.family.name] = min(size, detectable.get(s.family.name, np.inf))
                    units[s.family.name] = of.unit
        latent.threshold = clean
        if len(accepted) == most:
            # A third effect may still be there; what no known one is like, a free force shows.
            crowded = min(scan[0].log_factor / (3 * threshold), latent.evidence / clean) > 1
            break
        progress(0.24 + 0.16 * round_, "fits of the leaders")
        touching = _touching(current, scan, latent)
        rivals = fit_rivals(
            current, scan, inertial(current), touching, data, noise, bins, threshold
        )
        if rivals and rivals[0].evidence >= threshold:
            again = _restarted(current, rivals[0], data, noise, bins)
            if again is not None:
                current = again
                continue
        winner = winner_of(rivals, threshold, current, refused)
        if winner is None:
            break
        accepted.append(found(winner, rivals, current, len(columns)))
        winner = accepted[-1].rival
        # What every rope in motion has explains nothing away.
        most += winner.family.name == Inertia.name
        current = winner.fit
        current.forward.last = current.point.solution
        data = every.settled(current.point.seen)
        current = fit(current.forward, data, noise, bins, current.point.u, 10, tolerance=1e-5)
        current, accepted = reconsidered(
            current, accepted, threshold, len(columns), data, noise, bins
        )
    assert latent is not None
    left, was = unexplained(current), max(unexplained(nominal), 1e-9)
    names = {f.rival.family.name for f in accepted}
    # No motion is explained down to the noise of its markers, no drag between frames followed.
    moving, dragged = Inertia.name in names, ContactFriction.name in names
    explained = bool(accepted) and left <= (IN_MOTION if moving else NEGLIGIBLE) * was
    crowded = crowded and not ((moving or dragged) and explained)
    verdict = "unknown" if crowded else "found" if accepted else "none"
    if latent.evidence > latent.threshold and not explained:
        verdict = "unknown"
    return Diagnosis(
        verdict, accepted, nominal, current, noise, first_scan, threshold, latent, detectable,
        units, refused,
    )  # fmt: skip


def _noise(nominal: Fit, data: Data, noise: Noise, bins: int) -> Noise:
    """The noise beside what effects explain, those too that no scan shows to the full (contact, a
    rope that remembers): they would pass for noise of the ends, and then for nothing. Nor can it
    be measured against a rope that ought to be moving and is not."""
    for (start,) in inertial(nominal):
        moving = fit_rival(nominal, *start, data, noise, bins)
        if moving is not None and moving.evidence > LEAST:
            nominal = moving.fit
    columns = _columns(nominal, data, bins, [])
    found = measure(nominal, columns, noise, [])
    if not found.coloured:
        return found
    project, setup = Projection(nominal), nominal.point.setup
    scan = [Scorer(c, project, c.family.scales(setup))(project.z) for c in columns]
    scan.sort(key=lambda s: -s.log_factor)
    if scan[0].score > SHOWN * unexplained(nominal):
        return found
    hidden = [s for s in scan if s.family.effect.shaping]
    touching = _touching(nominal, scan, latent_force(nominal, project))
    rivals = fit_rivals(nominal, hidden, [], touching, data, noise, bins, LEAST)
    seen = nominal.stations.residual
    moves = [seen - r.fit.stations.residual for r in rivals if r.evidence > LEAST]
    return measure(nominal, columns, noise, moves) if moves else found


def _touching(current: Fit, scan: list[Scored], latent: Latent) -> list[list[Start]]:
    """What contact may have been, where anything is there at all: it is a force, in some frames."""
    anything = max(latent.evidence, scan[0].log_factor) > ANYTHING or uneven(current)
    return proposals(current) if anything else []


def _restarted(current: Fit, winner: Rival, data: Data, noise: Noise, bins: int) -> Fit | None:
    """The smaller model from the winner's values, if that is better: it had been stuck, and what
    got it going is no effect (DIAGNOSIS, section 5)."""
    begin = winner.fit.point.u[: current.forward.size]
    forward = Forward(current.forward.base, current.forward.terms, winner.fit.point.solution)
    again = attempted(forward, data, noise, bins, begin, 20, tolerance=1e-5)
    if again is None:
        return None
    return again if again.cost < current.cost - STUCK * winner.evidence else None


def _columns(current: Fit, data: Data, bins: int, accepted: list[Found]) -> list[Columns]:
    """Of every family, but those accepted already that have no other place to be."""
    responses = Responses(current, data, bins)
    taken = {key_of(f.rival.family) for f in accepted if not f.rival.family.effect.place_names}
    every = families(current.point.setup)
    return [responses.of(family) for family in every if key_of(family) not in taken]
