"""What a finished search says of a recording."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ropefit.diagnosis.acceptance import (
    BEYOND_SENSOR,
    MOST_RMS_RATIO_IN_MOTION,
    far_beyond_sensor,
    not_possible,
)
from ropefit.diagnosis.accepted import Accepted
from ropefit.diagnosis.full_scan import Scan
from ropefit.diagnosis.held_out import by_stretches, heldout_rms
from ropefit.diagnosis.latent_force import LatentForce
from ropefit.diagnosis.limits import Limits
from ropefit.diagnosis.unexplained import misses_more_than_elsewhere, unexplained
from ropefit.inference.least_squares import Fit

MOST_LEFT = 3.0  # times the noise, at rest, beside a force that can stand for much else
CROWDED_FACTOR = 3.0  # thresholds: a scan above it shows one effect more


def one_more(nominal: Fit, accepted: list[Accepted], scan: Scan, limits: Limits) -> bool:
    """Return whether one effect more than may be accepted is there: a free force shows it, and a
    known one is like it. Not asked where effects that are not exact explain a recording: with
    friction, whose scan takes minutes."""
    if scan.latent.evidence <= limits.latent:
        return False
    effects = [one.candidate.hypothesis.effect for one in accepted]
    if _explained(nominal, scan.current, accepted) and not all(e.exact for e in effects):
        return False
    return scan.scores[0].log_factor > CROWDED_FACTOR * limits.threshold


def _explained(nominal: Fit, final: Fit, accepted: list[Accepted]) -> bool:
    """Return whether the accepted effects leave no more than they may."""
    may_leave = [one.candidate.hypothesis.effect.may_leave for one in accepted]
    was = max(unexplained(nominal), 1e-9)
    return bool(accepted) and unexplained(final) <= max(may_leave) * was


def verdict_of(
    nominal: Fit, final: Fit, accepted: list[Accepted], latent: LatentForce, crowded: bool,
    refused: list[str],
) -> str:  # fmt: skip
    """Return none, found or unknown. crowded: more effects would be needed than may be accepted;
    refused: candidates that were not accepted, and why; to it goes what is not possible as it was
    fitted last."""
    explained = _explained(nominal, final, accepted)
    # Beside later effects, and fitted to the end, values may be what would not have been accepted.
    candidates = [replace(one.candidate, fit=final) for one in accepted]
    reasons = [(one.hypothesis.name, not_possible(one, final)) for one in candidates]
    refused += [f"{name}: {why}" for name, why in reasons if why]
    ended = final.problem.work.exhausted  # before all candidates were compared
    impossible = any(why for _, why in reasons)
    if ended or crowded or impossible or _stands_for_another(final, accepted):
        return "unknown"
    if latent.evidence > latent.threshold and not explained and not _as_good_as_noise(final):
        return "unknown"
    if not accepted and far_beyond_sensor(final):  # what no effect lowers is no noise for that
        return "unknown"
    noise = final.problem.noise  # with what the rope missed in the recording it is known from
    known = final.forward.instantaneous and noise.marker > BEYOND_SENSOR * noise.sensor > 0
    if not accepted and known and (refused or misses_more_than_elsewhere(final)):
        return "unknown"
    return "found" if accepted else "none"


def _stands_for_another(final: Fit, accepted: list[Accepted]) -> bool:
    """Return whether held-out data of a rope at rest are missed by several times the noise beside a
    force that can stand for much else."""
    effects = [one.candidate.hypothesis.effect for one in accepted]
    if not (final.forward.instantaneous and any(e.stands_for_others for e in effects)):
        return False
    missed, noise = heldout_rms(final, by_stretches(final))
    return missed > MOST_LEFT * noise


def _as_good_as_noise(final: Fit) -> bool:
    """Return whether a motion is missed by hardly more than noise: as an effect that explained it
    would not be accepted, a force that does is no sign of one."""
    if final.forward.instantaneous:
        return False
    missed = float(np.sqrt((final.stations.residual**2).mean()))
    return MOST_RMS_RATIO_IN_MOTION * missed <= final.problem.noise.marker
