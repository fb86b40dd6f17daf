"""A rod that moves: mass on its nodes and what resists motion, besides its statics in `rod.py`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ropefit.rod.either import Array, like, namespace
from ropefit.rod.fields import BODIES, OCTAVES
from ropefit.rod.rod import Properties, Rod, at_nodes

# [m/s]: at these the air's resistance is given where it is not in proportion to the speed.
DRAG_SPEEDS = 2.0 ** np.arange(OCTAVES[0], OCTAVES[1] + 1)


class Damping(NamedTuple):
    """Linear resistance, segment by segment (N,), or more dimensions in front.

    bend and twist [N m² s]: moment per rate of curvature and of twist; stretch [N s]: force per
    rate of strain (nothing where the rope cannot stretch); air [N s/m²]: force per length and
    speed.
    """

    bend: Array
    twist: Array
    stretch: Array
    air: Array


class Moving(NamedTuple):
    """The discrete rod in motion, with or without a dimension of R ropes in front.

    Besides the rod, the fields of `fields.MOTION`: strain_viscosity (N, 3) [N s] of the strains,
    bend_viscosity (N+1, 3) [N m s] of the bends; of the nodes mass (N+1,) [kg], spring (N+1,) [N/m]
    to the origin (a load moves its anchor) and air (N+1,) [N s/m]; drag (11,): what `air` is
    multiplied by at the speeds of `DRAG_SPEEDS`, its logarithm; bodies (B, 8) that the nodes touch:
    a point [m], unit normal of a plane or axis of a bar, radius [m], kind (`fields.PLANE`, ...).
    The segments have no spin inertia.
    """

    rod: Rod
    strain_viscosity: Array
    bend_viscosity: Array
    mass: Array
    spring: Array
    air: Array
    drag: Array
    bodies: Array


def undamped(p: Properties) -> Damping:
    """Return no resistance at all."""
    zero = namespace(p.length).zeros_like(p.length)
    return Damping(zero, zero, zero, zero)


def moving(
    p: Properties,
    rod: Rod,
    damping: Damping,
    attached: Array | None = None,
    drag: Array | None = None,
    spring: Array | None = None,
    bodies: Array | None = None,
) -> Moving:
    """Return the rod of properties p in motion; attached (N+1,) [kg]: masses on its nodes.

    spring (N+1,), drag (11,) and bodies (b, 8) as in `Moving`; None: no springs, drag in proportion
    to speed, nothing to touch. Raises ValueError for more than `fields.BODIES` bodies.

    The viscosity of a bend is its stiffness times the relaxation times bend/EI and twist/GJ [s] of
    the segments beside it, averaged by length.
    """
    xp = namespace(p.length)
    touched = like(np.zeros((0, 8)) if bodies is None else bodies, p.length)
    if len(touched) > BODIES:
        raise ValueError(f"a rope in motion can touch {BODIES} bodies, not {len(touched)}")
    share = at_nodes(p.length)
    bend = at_nodes(p.length * damping.bend / p.bend) / share
    twist = at_nodes(p.length * damping.twist / p.twist) / share
    zero = xp.zeros_like(damping.stretch)
    own = at_nodes(0.5 * p.density * p.length)
    return Moving(
        rod=rod,
        strain_viscosity=xp.stack([zero, zero, damping.stretch], axis=-1),
        bend_viscosity=rod.stiffness * xp.stack([bend, bend, twist], axis=-1),
        mass=own if attached is None else own + attached,
        spring=xp.zeros_like(own) if spring is None else spring,
        air=at_nodes(0.5 * damping.air * p.length),
        drag=like(np.zeros(len(DRAG_SPEEDS)) if drag is None else drag, own),
        bodies=xp.concat([touched, like(np.zeros((BODIES - len(touched), 8)), own)]),
    )
