"""PyElastica: a script that makes a Cosserat rod and lets it come to rest."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ropefit.attachments import Cylinder, EndTwist, Plane, Sphere, Tether
from ropefit.exporters.base import Exporter, ExportResult, Simulator, diameter_of, friction_note
from ropefit.exporters.description import RopeDescription
from ropefit.exporters.layout import Layout, lay_out
from ropefit.exporters.rotation import matrix
from ropefit.exporters.script import assign, directors, literal, title

STIFF = 2000.0  # EA and GA at most this many rope weights: 0.05 % of stretch by its own weight


class PyElastica(Exporter):
    """A script for PyElastica 1.0: `python rope.py --pose 0 --out shape.csv`.

    PyElastica steps explicitly, so an inextensible rope would need endless steps: EA and GA are
    written no larger than STIFF rope weights, and thin segments get more rotary inertia than they
    have. Neither moves the shape at rest by more than its stretch.
    """

    target: ClassVar[str] = "pyelastica"
    suffix: ClassVar[str] = ".py"
    simulator: ClassVar[Simulator | None] = Simulator("elastica", "pyelastica==1.0.0")

    def export(self, rope: RopeDescription) -> ExportResult:
        layout, lost = lay_out(rope), []
        radius = diameter_of(rope, lost) / 2
        weight = float(layout.masses.sum() * np.linalg.norm(rope.gravity))
        most = STIFF * weight if weight > 0 else np.inf
        EA, GA = np.minimum(layout.EA, most), np.minimum(layout.GA, most)
        if not (np.isfinite(EA).all() and np.isfinite(GA).all()):
            # Without gravity nothing pulls: stiff against bending is stiff enough.
            bending = STIFF * float((layout.EI / layout.voronoi**2).max())
            EA, GA = (np.where(np.isfinite(a), a, bending) for a in (EA, GA))
        if (EA < layout.EA).any():
            lost.append(
                f"EA above {EA.max():.4g} N: the rope stretches by up to {1 / STIFF:.2%} under its "
                "own weight, more when pulled; an explicit step cannot follow a stiffer one"
            )
        if (GA < layout.GA).any():
            lost.append(f"GA above {GA.max():.4g} N, for the same reason")
        lost.append("the rotary inertia of a thin rope: it is raised to what the time step allows")
        _obstacle_notes(rope, layout, lost)
        friction_note(rope, lost)
        inertia, step = _inertia(layout, EA, GA, radius)
        lines = [
            *title(rope, "A rope for PyElastica 1.0.", lost),
            IMPORTS,
            assign("MASSES", layout.masses, "(V,) kg"),
            assign("EA", EA, "(V-1,) N"),
            assign("GA", GA, "(V-1,) N"),
            assign("EI", layout.EI, "(V-2,) N m^2"),
            assign("GJ", layout.GJ, "(V-2,) N m^2"),
            assign("REST_X", layout.rest_x, "(V, 3) m, stress-free"),
            assign(
                "REST_D", np.swapaxes(matrix(layout.rest_q), -1, -2), "(V-1, 3, 3) rows d1 d2 d3"
            ),
            assign("START_X", layout.start, "(P, V, 3) m, each pose"),
            assign(
                "START_D",
                np.array([directors(layout, pose) for pose in range(rope.poses)]),
                "(P, V-1, 3, 3)",
            ),
            assign("GRAVITY", rope.gravity, "m/s^2"),
            assign("NODES", layout.node[layout.node >= 0], "nodes of the rope that are vertices"),
            f"HELD = {layout.held}  # vertices held at end 0, end 1: 1 pinned, 2 clamped",
            f"RADIUS = {radius:.10g}  # m",
            assign("ROTARY", inertia, "(V-1,) kg m^2, raised for the time step"),
            f"STEP = {step:.6g}  # s",
            *_effects(rope, layout),
            BODY,
        ]
        return ExportResult("\n".join(lines), {}, tuple(lost))


def _inertia(
    layout: Layout, EA: np.ndarray, GA: np.ndarray, radius: float
) -> tuple[np.ndarray, float]:
    """Return rotary inertia (V-1,) and the time step: rotation must not be faster than
    stretching."""
    light = np.minimum(layout.masses[:-1], layout.masses[1:])
    fastest = 2 * float(np.sqrt(np.maximum(EA, GA) / layout.lengths / light).max())  # rad/s
    spring = layout.EI / layout.voronoi
    stiff = np.concatenate([[0.0], spring]) + np.concatenate([spring, [0.0]])
    stiff = 2 * stiff + GA * layout.lengths
    own = (layout.masses[:-1] + layout.masses[1:]) / 2 * radius**2 / 4
    return np.maximum(own, 4 * stiff / fastest**2), 0.5 / fastest


def _obstacle_notes(rope: RopeDescription, layout: Layout, lost: list[str]) -> None:
    for effect in rope.effects:
        if isinstance(effect, Plane | Sphere | Cylinder) and effect.friction > 0:
            lost.append(f"friction {effect.friction:g} of a {type(effect).__name__.lower()}")
        if isinstance(effect, Tether) and layout.vertex(effect.node) not in layout.free:
            lost.append(f"the tether at node {effect.node}: the end there is held")
        if isinstance(effect, EndTwist) and rope.end_kinds[effect.end] != "clamped":
            lost.append(f"the twist of {effect.angle:g} rad at end {effect.end}: it is not clamped")


def _effects(rope: RopeDescription, layout: Layout) -> list[str]:
    planes, bars, tethers = [], [], []
    for effect in rope.effects:
        if isinstance(effect, Plane):
            normal = np.array(effect.normal) / np.linalg.norm(effect.normal)
            planes.append([*effect.point, *normal])
        elif isinstance(effect, Sphere):
            bars.append([*effect.centre, *effect.centre, effect.radius])
        elif isinstance(effect, Cylinder):
            bars.append([*effect.start, *effect.stop, effect.radius])
        elif isinstance(effect, Tether) and layout.vertex(effect.node) in layout.free:
            vertex = layout.vertex(effect.node)
            tethers.append([vertex, *effect.anchor, effect.stiffness, effect.rest_length])
    return [
        f"PLANES = {literal(np.array(planes).reshape(-1, 6))}  # point, unit normal",
        f"BARS = {literal(np.array(bars).reshape(-1, 7))}  # start, stop, radius",
        f"TETHERS = {literal(np.array(tethers).reshape(-1, 6))}  # vertex, anchor, N/m, m",
    ]


IMPORTS = """import argparse
import sys

import elastica as ea
import numpy as np
"""

BODY = '''
DRAG = 8.0  # 1/s on every velocity, so that the rope comes to rest; no property of the rope
REST = 2e-5  # m/s, a rope slower than this is at rest
LONGEST = 30.0  # s
CONTACT = 5e3 * MASSES.sum() * np.linalg.norm(GRAVITY) / len(MASSES)  # N/m at a vertex


class Simulation(
    ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Damping, ea.CallBacks
):
    pass


class Surroundings(ea.NoForces):
    """Supports and obstacles push vertices out; tethers pull when longer than at rest."""

    def apply_forces(self, system, time=0.0):
        x, force = system.position_collection, system.external_forces
        for plane in PLANES:
            point, normal = np.array(plane[:3]), np.array(plane[3:])
            depth = RADIUS - normal @ (x - point[:, None])
            force += CONTACT * np.maximum(depth, 0.0) * normal[:, None]
        for bar in BARS:
            start, along = np.array(bar[:3]), np.array(bar[3:6]) - np.array(bar[:3])
            square = along @ along
            share = (along @ (x - start[:, None])) / square if square else np.zeros(x.shape[1])
            inside = (share >= 0) & (share <= 1)
            away = x - start[:, None] - np.clip(share, 0, 1) * along[:, None]
            distance = np.linalg.norm(away, axis=0)
            depth = np.where(inside, RADIUS + bar[6] - distance, 0.0)
            force += CONTACT * np.maximum(depth, 0.0) * away / np.maximum(distance, 1e-12)
        for vertex, ax, ay, az, stiffness, rest in TETHERS:
            pull = np.array([ax, ay, az]) - x[:, int(vertex)]
            length = np.linalg.norm(pull)
            if length > rest:
                force[:, int(vertex)] += stiffness * (1 - rest / length) * pull


def make_rod(pose):
    """The rod in a pose; its stress-free shape is taken from REST_X and REST_D."""
    lengths = np.linalg.norm(np.diff(REST_X, axis=0), axis=1)
    rod = ea.CosseratRod.straight_rod(
        len(lengths), REST_X[0], REST_D[0, 2], REST_D[0, 0], float(lengths.sum()), RADIUS,
        1000.0, youngs_modulus=1e6, shear_modulus=4e5,
        position=REST_X.T.copy(), directors=np.moveaxis(REST_D, 0, -1).copy(),
    )
    rod.rest_kappa[:] = rod.kappa
    rod.rest_sigma[:] = 0.0
    rod.shear_matrix[:] = 0.0
    rod.shear_matrix[0, 0], rod.shear_matrix[1, 1], rod.shear_matrix[2, 2] = GA, GA, EA
    rod.bend_matrix[:] = 0.0
    rod.bend_matrix[0, 0], rod.bend_matrix[1, 1], rod.bend_matrix[2, 2] = EI, EI, GJ
    rod.mass[:] = MASSES
    rod.mass_second_moment_of_inertia[:] = np.eye(3)[..., None] * ROTARY
    rod.inv_mass_second_moment_of_inertia[:] = np.eye(3)[..., None] / ROTARY
    rod.position_collection[:] = START_X[pose].T
    rod.director_collection[:] = np.moveaxis(START_D[pose], 0, -1)
    return rod


def settle(pose):
    """Vertices (V, 3) [m] at rest and the time [s] that took."""
    simulation, rod = Simulation(), make_rod(pose)
    simulation.append(rod)
    last = len(MASSES) - 1
    positions = tuple(range(HELD[0])) + tuple(range(last + 1 - HELD[1], last + 1))
    turned = ((0,) if HELD[0] == 2 else ()) + ((last - 1,) if HELD[1] == 2 else ())
    if positions:
        simulation.constrain(rod).using(
            ea.FixedConstraint,
            constrained_position_idx=positions,
            constrained_director_idx=turned,
        )
    simulation.add_forcing_to(rod).using(ea.GravityForces, acc_gravity=GRAVITY)
    if PLANES or BARS or TETHERS:
        simulation.add_forcing_to(rod).using(Surroundings)
    simulation.dampen(rod).using(
        ea.AnalyticalLinearDamper, uniform_damping_constant=DRAG, time_step=STEP
    )
    simulation.finalize()
    stepper, time, calm = ea.PositionVerlet(), np.float64(0.0), 0
    every = max(int(0.01 / STEP), 1)
    while time < LONGEST:
        before = rod.position_collection.copy()
        for _ in range(every):
            time = stepper.step(simulation, time, np.float64(STEP))
        speed = np.abs(rod.position_collection - before).max() / (every * STEP)
        if not np.isfinite(speed):
            sys.exit("the rope exploded; lower STEP")
        calm = calm + 1 if speed < REST else 0  # slow too at the turning point of a swing
        if calm > 20:
            return rod.position_collection.T.copy(), float(time)
    sys.exit(f"still moves at {speed:.2e} m/s after {LONGEST:g} s")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pose", type=int, default=0)
    parser.add_argument("--out", help="csv of the vertices at rest: x,y,z")
    options = parser.parse_args()
    shape, time = settle(options.pose)
    print(f"at rest after {time:.2f} s")
    if options.out:
        np.savetxt(options.out, shape, delimiter=",", header="x,y,z", comments="")
'''
