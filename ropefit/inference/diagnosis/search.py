"""The diagnosis: one effect at a time, until what is left is noise (DIAGNOSIS, section 5)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ropefit.effects import Inertia
from ropefit.inference.diagnosis.absorbed import absorbed
from ropefit.inference.diagnosis.background import measure
from ropefit.inference.diagnosis.branch_repair import repaired
from ropefit.inference.diagnosis.columns import Columns, Responses
from ropefit.inference.diagnosis.contact import Start, proposals, uneven
from ropefit.inference.diagnosis.evidence import Projection, Scored, Scorer, null_residuals
from ropefit.inference.diagnosis.families import Family, families
from ropefit.inference.diagnosis.in_motion import inertial
from ropefit.inference.diagnosis.latent import Latent, latent_force
from ropefit.inference.diagnosis.profile import profile
from ropefit.inference.diagnosis.ties import equivalents, ordered
from ropefit.inference.diagnosis.weigh import Rival, fit_rival, heldout_rms, touches
from ropefit.inference.forward import Forward
from ropefit.inference.least_squares import Fit, fit
from ropefit.inference.noise import Noise
from ropefit.inference.stations import Data, match

LEAST = 5.0  # nats: no effect is believed on less
MARGIN = 10.0  # nats over a clean recording's 99 % that make a latent force real
REPLICATES = 100
ANYTHING = 2.0  # nats
STUCK = 0.2  # of a winner's evidence: gained without it, by beginning elsewhere
MOST_EFFECTS = 2  # more would explain anything: then it is unknown
LEADERS = 6
IMPLAUSIBLE = 30.0  # usual sizes: what large no rope or set-up has
NEUTRAL = 1.0  # nats that a held-out block may gain by chance
AT_MOST = 0.3  # of what blocks gain may others lose
SHOWN = 0.7  # of the misfit: what a scan explains of it in one place
IN_MOTION = 0.5  # of the first misfit: what may stay once inertia is found
NEGLIGIBLE = 0.15  # of the first misfit: what may stay unexplained once an effect is found


@dataclass
class Found:
    """An accepted effect, the rivals that explain as much, and how sure it is."""

    rival: Rival
    equivalent: list[Rival]
    evidence: float
    p_value: float


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
    nominal = _repair(nominal, data, noise, bins)
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
        rivals = _rivals(current, scan, inertial(current), touching, data, noise, bins, threshold)
        if rivals and rivals[0].evidence >= threshold:
            again = _restarted(current, rivals[0], data, noise, bins)
            if again is not None:
                current = again
                continue
        winner = _winner(rivals, threshold, current, refused)
        if winner is None:
            break
        winner, same = ordered(winner, equivalents(winner, rivals, current.cost))
        p = min(1.0, len(columns) * float(np.exp(-min(winner.evidence, 690.0))))
        accepted.append(Found(winner, same, winner.evidence, max(p, 1e-300)))
        # What every rope in motion has explains nothing away.
        most += winner.family.name == Inertia.name
        current = winner.fit
        current.forward.last = current.point.solution
        data = every.settled(current.point.seen)
        current = fit(current.forward, data, noise, bins, current.point.u, 10, tolerance=1e-5)
    assert latent is not None
    left, was = unexplained(current), max(unexplained(nominal), 1e-9)
    moving = any(f.rival.family.name == Inertia.name for f in accepted)
    # No motion is explained down to the noise of its markers.
    explained = bool(accepted) and left <= (IN_MOTION if moving else NEGLIGIBLE) * was
    crowded = crowded and not (moving and explained)
    verdict = "unknown" if crowded else "found" if accepted else "none"
    if latent.evidence > latent.threshold and not explained:
        verdict = "unknown"
    return Diagnosis(
        verdict, accepted, nominal, current, noise, first_scan, threshold, latent, detectable,
        units, refused,
    )  # fmt: skip


def _repair(found: Fit, data: Data, noise: Noise, bins: int) -> Fit:
    """Frames on the wrong branch are brought to the right one, and the fit repeated."""
    states = repaired(found, data, bins)
    if states is None:
        return found
    forward = Forward(found.forward.base, found.forward.terms, states)
    again = fit(forward, data, noise, bins, found.point.u, 20, tolerance=1e-5)
    return again if again.cost < found.cost else found


def _noise(nominal: Fit, data: Data, noise: Noise, bins: int) -> Noise:
    """The noise beside what effects explain, those too that no scan shows to the full (contact, a
    rope that remembers): they would pass for noise of the ends, and then for nothing."""
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
    rivals = _rivals(nominal, hidden, [], touching, data, noise, bins, LEAST)
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
    try:
        again = fit(forward, data, noise, bins, begin, 20, tolerance=1e-5)
    except (ArithmeticError, ValueError, np.linalg.LinAlgError):
        return None
    return again if again.cost < current.cost - STUCK * winner.evidence else None


def _columns(current: Fit, data: Data, bins: int, accepted: list[Found]) -> list[Columns]:
    """Of every family, but those accepted already that have no other place to be."""
    responses = Responses(current, data, bins)
    taken = {_key(f.rival.family) for f in accepted if not f.rival.family.effect.place_names}
    every = families(current.point.setup)
    return [responses.of(family) for family in every if _key(family) not in taken]


def _key(family: Family) -> tuple[str, int]:
    return type(family.effect).__name__, family.effect.end


def _rivals(
    current: Fit, scan: list[Scored], driven: list[list[Start]], touching: list[list[Start]],
    data: Data, noise: Noise, bins: int, threshold: float,
) -> list[Rival]:  # fmt: skip
    """Full fits of the families that a scan puts in front, of what motion proposes, and, unless the
    best of these leaves next to nothing, of contact."""
    highest = max((s.log_factor for s in scan), default=0.0)
    leaders = [s for s in scan if s.log_factor > min(threshold, 0.5 * highest)][:LEADERS]
    starts = [
        [(s.family, np.concatenate([sizes, place]))]
        for s in leaders
        if s.log_factor > 0.6 * threshold
        for sizes, place in s.starts()
    ]
    out: dict[tuple[str, int], Rival] = {}

    def weigh(choices: list[Start]) -> None:
        fitted = (fit_rival(current, family, at, data, noise, bins) for family, at in choices)
        rival = next((rival for rival in fitted if rival is not None), None)
        if rival is None:
            return
        better = _repair(rival.fit, data, noise, bins)
        if better is not rival.fit:
            rival = fit_rival(current, rival.family, rival.values(), data, noise, bins) or rival
        key = _key(rival.family)
        if key not in out or rival.evidence > out[key].evidence:
            out[key] = rival

    for choices in starts + driven:
        weigh(choices)

    def best() -> Rival | None:
        return max(out.values(), key=lambda r: r.evidence, default=None)

    def wanting(rival: Rival) -> bool:
        return unexplained(rival.fit) > NEGLIGIBLE * unexplained(current)

    first = best()
    if (
        first
        and first.family.effect.locus == "interval"
        and first.evidence > threshold
        and wanting(first)
    ):
        start = profile(current, first.family, data, noise, bins)
        weigh([] if start is None else [(first.family, start)])
        first = best()
    if first is None or wanting(first) or uneven(first.fit):
        for choices in touching:  # these cost the most
            weigh(choices)
    return sorted(out.values(), key=lambda r: -r.evidence)


def unexplained(found: Fit) -> float:
    """χ² beyond what noise has."""
    return float(found.z @ found.z) - len(found.z)


def _winner(
    rivals: list[Rival], threshold: float, current: Fit, refused: list[str]
) -> Rival | None:
    """The strongest rival that passes every gate; current: the model without any of them."""
    for rival in rivals:
        if rival.evidence < threshold:
            return None
        along = touches(rival.fit)
        worse = heldout_rms(rival.fit, along)[0] > 1.01 * heldout_rms(current, along)[0]
        # A calibration error far outside its prior explains held-out frames as well as the effect
        # of the same kind does: there the evidence is in the prior.
        effect = rival.family.effect
        believed = effect.kind == "measurement" or effect.calibrated
        agreeing = _agreeing(rival.gains)
        sizes = np.abs(rival.values()[: rival.family.size]) / rival.term.scale[: rival.family.size]
        if rival.family.effect.linear and sizes.max() > IMPLAUSIBLE:
            refused.append(f"{rival.family.name}: larger than anything plausible")
        elif rival.clear() < 1:
            refused.append(f"{rival.family.name}: its size could as well be nothing")
        elif worse or not (believed or agreeing):
            refused.append(f"{rival.family.name}: held-out frames do not support it")
        else:
            return rival
    return None


def _agreeing(gains: np.ndarray) -> bool:
    """Whether held-out blocks support an effect, by their gains [nats]: more than one gains, and
    the others lose little against that. A rope may touch a plane in few frames; the others gain
    and lose nothing, and what is barely visible gains and loses by chance.
    """
    lost, gained = -gains[gains < 0].sum(), gains[gains > 0].sum()
    return bool((gains > NEUTRAL).sum() > 1 and lost <= AT_MOST * gained)
