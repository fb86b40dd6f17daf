"""From observations to what the equilibrium model works on: the setup, and the data in space."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ropefit.adapters.end_path import end_path
from ropefit.adapters.motion_of import centrelines, motion_of
from ropefit.artifacts import Observations
from ropefit.effects.place import at_point, over_interval
from ropefit.errors import BadInput
from ropefit.inference.bins import Data, match
from ropefit.rod.rod import uniform
from ropefit.rod.setup import Setup, bare

FINEST = 160  # segments, about: at 80 a pinned rope's EI is 0.2 to 0.5 % off, a clamped one's 2 %
CLAMPED = 240
FEWEST = 0.4  # of those, for a rope as stiff as can be: effects have places
UNKNOWN_SURFACE = 0.003  # m: half of how thick a rope of unknown diameter may be
STATIONS = 40  # of a frame: stretches short enough for the rope to be straight there
LIKELY_STIFFNESS = 3e-4  # EI over weight per length and length cubed: where a fit starts


def refinement(nodes: int, finest: int = FINEST) -> int:
    """Return segments of the rod for each segment of the observations."""
    return max(1, round(finest / (nodes - 1)))


def segments_of(o: Observations) -> int:
    """Return segments of the rod in all. A clamp bends the rope within a few centimetres, where
    coarse segments would pass for stiffness."""
    finest = CLAMPED if "clamped" in o.end_kind else FINEST
    return refinement(len(o.node_arc), finest) * (len(o.node_arc) - 1)


def segments_for(o: Observations, bending_length: float) -> int:
    """Return segments of a rope of a bending length [m] that markers are compared with: none longer
    in terms of it than those of a rope as soft as they are made for. A stiffer one needs fewer."""
    every, parts = segments_of(o), len(o.node_arc) - 1
    if o.source != "markers":
        return every
    softer = LIKELY_STIFFNESS ** (1 / 3) * o.length / max(bending_length, 1e-12)
    return max(round(every / parts * min(max(softer, FEWEST), 1.0)), 1) * parts


def fewer_segments(o: Observations, segments: int) -> int | None:
    """Return about a third of them, for what is only explored; None where there is no such mesh."""
    parts = len(o.node_arc) - 1
    every = segments // parts
    return max(round(every / 3), 1) * parts if every > 1 else None


def base_setup(o: Observations, segments: int) -> Setup:
    """Return the nominal rope in every frame: the weight known or one kilogram a metre, never
    stretching.

    Raises BadInput where no end is held, there is no gravity, or pictures tell too little.
    """
    size = float(np.linalg.norm(o.gravity))
    stated = not o.ends_assumed and o.length_source == "recording"
    if not o.depth_measured and not (stated and "free" not in o.end_kind):
        raise BadInput(
            "pictures without depth: the equilibrium model needs [rope] length and the poses of "
            "both ends ([ends]) in the recording"
        )
    if size == 0:
        raise BadInput("the equilibrium model needs gravity: without it shapes fix no stiffness")
    if all(kind == "free" for kind in o.end_kind):
        raise BadInput("neither end is held: nothing says where the rope hangs")
    return setup_of(o, segments)


def setup_of(o: Observations, segments: int) -> Setup:
    """Return the same, whatever the recording lacks."""
    density = o.mass / o.length if o.mass else 1.0
    size = float(np.linalg.norm(o.gravity)) or 1.0
    bend = LIKELY_STIFFNESS * density * size * o.length**3
    setup = bare(
        uniform(length=o.length, segments=segments, bend=bend, density=density),
        o.gravity,
        o.end_position,
        o.end_orientation,
        o.view.pose[:3, 3],
    )
    sensor = setup.sensor._replace(
        origin=o.plane_origin[:, None], normal=o.plane_normal[:, None], standoff=_standoff(o)
    )
    setup = setup._replace(
        sensor=sensor, motion=motion_of(o, setup.arc), time=o.time,
        end_path=end_path(o.time, o.frames, o.end_position, o.end_orientation, o.length),
    )  # fmt: skip
    setup = with_fittings(setup, o)
    if not o.end_twist_known:  # the clamps bend the rope but let it spin
        clamp_compliance = np.zeros((2, 2))
        clamp_compliance[:, 1] = np.inf
        setup = setup._replace(clamp_compliance=clamp_compliance)
    return setup


def with_fittings(setup: Setup, o: Observations) -> Setup:
    """Return the setup with the rigid pieces that the recording states, and their weights."""
    arc, mass, rigid = setup.arc, setup.mass, setup.rigid
    for piece in o.fittings.values():
        at, long = np.array([piece.arc_length, piece.length])
        share = at_point(arc, at)
        if piece.length:
            inside = over_interval(arc, at, long)
            rigid = inside if rigid is None else np.maximum(rigid, inside)
            part = inside * setup.properties.length / (inside * setup.properties.length).sum()
            half = np.pad(0.5 * part, 1)
            share = half[1:] + half[:-1]
        mass = mass + piece.mass * share
    return setup._replace(mass=mass, rigid=rigid)


def data_in_space(o: Observations) -> Data:
    """Return the observed points, with what a projection took from them put back."""
    counts = np.diff(o.point_start)
    frames, most = len(counts), int(counts.max())
    mask = np.arange(most) < counts[:, None]
    points, share = np.zeros((frames, most, 3)), np.zeros((frames, most))
    normal = np.repeat(o.plane_normal, counts, axis=0)
    back = o.point_offset[:, None] * normal if o.projected else 0.0
    points[mask] = o.points + back
    share[mask] = o.point_arc / o.length
    eye = o.view.pose[:3, 3].copy()
    data = Data(points, share, mask, o.source == "markers", eye, depth=o.depth_measured)
    if o.point_before is None or not o.diameter:
        return data
    before = np.zeros((frames, most))
    before[mask] = o.point_before
    whole = replace(data, before=before, radius=0.5 * o.diameter)
    return whole if _looks_round(o, whole) else data


def _looks_round(o: Observations, data: Data) -> bool:
    """Return whether the points' depths fall away to both sides as on a round rope, rather than not
    at all: not after a projection, nor where a sensor blurs a thin rope."""
    line = centrelines(o, o.node_arc)
    whole = np.flatnonzero(np.isfinite(line).all(axis=(1, 2)))
    if not len(whole):
        return True
    some = data.frames(whole)
    round_, flat = (
        match(one, line[whole], STATIONS).scatter for one in (some, replace(some, radius=0.0))
    )
    return bool(len(round_) and round_[0, 1] < flat[0, 1])


def _standoff(o: Observations) -> np.ndarray:
    """Return [m] how far the points were moved from the visible surface to the axis, on average."""
    before = o.point_before
    return np.array(before.mean() if before is not None and len(before) else 0.0)


def surface_sd(o: Observations) -> float:
    """Return [m] one sigma of what is left of the way from the visible surface to the axis."""
    if o.source == "markers":
        return 0.0
    return 0.075 * o.diameter if o.diameter else UNKNOWN_SURFACE
