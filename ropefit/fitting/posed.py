"""A recording at rest as a problem of least squares, from a rope that is known from another run or
as identified."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ropefit.adapters.frames import spread_evenly
from ropefit.adapters.priors import noise_of, off_axis_sd
from ropefit.adapters.rope_setup import (
    STATIONS,
    base_setup,
    data_in_space,
    fewer_segments,
    segments_for,
)
from ropefit.adapters.settings import DiagnoseSettings
from ropefit.adapters.taken_over import TakenOver, noise_there, of_rope
from ropefit.artifacts import Diagnosis, Model, Observations
from ropefit.diagnosis.noise_measurement import on_edge
from ropefit.fitting.free_law import own_laws
from ropefit.fitting.handed_on import known_together, same_markers
from ropefit.fitting.nominal import (
    nominal_at_rest,
    nominal_terms,
    set_up_errors,
    with_what_is_missed,
)
from ropefit.inference.least_squares import Fit
from ropefit.inference.problem import FitProblem
from ropefit.models.priors import markers_off_axis
from ropefit.models.terms import Term
from ropefit.rod.setup import Setup

FEWEST_FRAMES = 4
PATH_FRAMES = 2  # times the compared frames: those that a path-dependent rope goes through


@dataclass(frozen=True)
class KnownRope:
    """The rope of a recording: model, and of another run what was found there; whether that is a
    recording of its own, and the run whose camera and gravity are known."""

    model: Model
    found: Diagnosis | None = None
    elsewhere: bool = False
    calibration: Model | None = None


@dataclass(frozen=True)
class Posed:
    """used (F,): the frames that are compared; the rope in them, also of fewer segments; the terms
    of the nominal model, and which of these another run found; the data with their noise."""

    used: np.ndarray
    setup: Setup
    coarser: Setup | None
    terms: list[Term]
    taken: list[TakenOver]
    problem: FitProblem

    def fitted(self) -> Fit:
        """Fit the nominal model. Raises NotConverged."""
        return nominal_at_rest(self.setup, self.terms, self.problem, self.coarser)

    def without(self, lost: np.ndarray) -> Posed:
        """Return the same without frames, lost (F,)."""
        firm = np.flatnonzero(~lost)
        return replace(
            self, used=self.used[firm], setup=self.setup.frames(firm),
            coarser=self.coarser and self.coarser.frames(firm), problem=self.problem.frames(firm),
        )  # fmt: skip

    def firm(self) -> tuple[Posed, Fit] | None:
        """Return the problem without the frames at the edge of stability, and its nominal fit; None
        where too few are left. Without some frames, others may be at the edge. Raises NotConverged.
        """
        problem = self
        while len(problem.used) >= FEWEST_FRAMES:
            nominal = problem.fitted()
            edge = on_edge(nominal)
            if not edge.any():
                return problem, nominal
            problem = problem.without(edge)
        return None


def posed(
    o: Observations, rope: KnownRope, settings: DiagnoseSettings, errors: bool = True,
    control: Fit | None = None,
) -> Posed:  # fmt: skip
    """Return a recording at rest as a problem; errors: whether those of the set-up are fitted;
    control: the fit of the recording that the rope is known from."""
    balance = rope.model.nominal.balance
    many = segments_for(o, balance.bending_length if balance else 0.0)
    used = spread_evenly(
        np.arange(len(o.frames)), np.zeros(len(o.frames), dtype=np.int64), settings.most_frames
    )
    data = data_in_space(o).frames(used)
    noise = noise_of(o, data)
    if rope.elsewhere and data.material:
        noise = with_what_is_missed(noise, rope.model, _measured_there(rope, o))

    def described(segments: int) -> tuple[list[Term], Setup]:
        setup = compared(base_setup(o, segments), used, settings.most_frames)
        uneven = rope.elsewhere and data.material
        return nominal_terms(o, rope.model, setup, settings.nominal, rope.elsewhere, uneven)

    terms, setup = described(many)
    taken = (
        of_rope(rope.model, rope.found, o, setup)
        if rope.found
        else own_laws(rope.model.nominal, setup)
    )
    terms += [term for _, _, term in taken]
    offsets = markers_off_axis(setup, off_axis_sd(o)) if errors else []
    if control is not None:
        if same_markers(data, control.problem.data):
            terms, offsets = [*terms, *offsets], []
        known = known_together(terms, control)
        now = {id(old): new for old, new in zip(terms, known, strict=True)}
        terms, taken = known, [(name, cause, now[id(term)]) for name, cause, term in taken]
    terms += offsets
    if errors:
        terms += set_up_errors(setup, o, rope.calibration)
    fewer = fewer_segments(o, many)
    coarser = described(fewer)[1] if fewer else None
    return Posed(used, setup, coarser, terms, taken, FitProblem(data, noise, STATIONS))


def _measured_there(rope: KnownRope, o: Observations) -> float:
    """Return the noise of a coordinate [m] in the recording that a rope is known from, at most what
    is missed there; infinite where that of this recording is told or measured: what preprocess says
    of few frames is an upper bound."""
    if not o.noise_bounded:
        return np.inf
    measured = noise_there(rope.found) if rope.found else np.inf
    return min(measured, rope.model.nominal.rms_fit) / 3**0.5


def compared(setup: Setup, used: np.ndarray, most: int) -> Setup:
    """Return the setup in the frames `used`, which a path-dependent rope reaches through some of
    the others: as many again, evenly spread."""
    every = np.arange(len(setup.ends))
    between = spread_evenly(every, np.zeros_like(every), PATH_FRAMES * most)
    passed = np.union1d(used, between)
    through = setup.frames(passed)._replace(past=None)
    return through.frames(np.searchsorted(passed, used))
