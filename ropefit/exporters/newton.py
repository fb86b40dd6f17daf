"""Newton: a script with solver settings, and the same rope as USD curves."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ropefit.attachments import Cylinder, Plane, Sphere, Tether
from ropefit.exporters.base import Exporter, ExportResult, Simulator, diameter_of
from ropefit.exporters.dahl import dahl
from ropefit.exporters.description import RopeDescription
from ropefit.exporters.layout import Layout, lay_out
from ropefit.exporters.script import assign, title
from ropefit.exporters.usd import curves

STIFF = 2000.0  # EA and GA at most this many rope weights


class Newton(Exporter):
    """A script for Newton 1.8 (`python rope.py --pose 0 --out shape.csv`) and `rope.usda`.

    Solver settings are part of the answer: with few iterations its solver shows a softer rope. A
    clamped rope with EI/(rho g L^3) = 0.01 and 41 nodes came to rest 5.5 % of its length from the
    elastica with 60 iterations, 0.9 % with the 240 that are written.
    """

    target: ClassVar[str] = "newton"
    suffix: ClassVar[str] = ".py"
    simulator: ClassVar[Simulator | None] = Simulator("newton", "newton==1.8.0", least=(1, 8))

    def export(self, rope: RopeDescription) -> ExportResult:
        layout, lost = lay_out(rope), []
        radius = diameter_of(rope, lost) / 2
        EA, GA = _softened(rope, layout, lost)
        for effect in rope.effects:
            if isinstance(effect, Plane | Sphere | Cylinder | Tether):
                lost.append(f"a {type(effect).__name__.lower()}: add it to the builder by hand")
        bend = layout.EI / layout.voronoi
        strains, decay = dahl(rope, bend, layout.voronoi)
        if strains.any():
            lost.append(
                "friction of bending acts on each axis by itself in Newton, on twist too, and "
                "builds up exponentially (Dahl)"
            )
        lost.append("the mass of a node is carried by the two segments beside it, half each")
        lines = [
            *title(rope, "A rope for Newton 1.8.", lost),
            IMPORTS,
            assign("START_X", layout.start, "(P, V, 3) m, each pose"),
            assign(
                "START_Q", _xyzw(np.array([layout.frames(p) for p in range(rope.poses)])), "xyzw"
            ),
            assign("REST_X", layout.rest_x, "(V, 3) m, stress-free"),
            assign("REST_Q", _xyzw(layout.rest_q), "(V-1, 4) xyzw"),
            assign("MASSES", _segment_masses(layout), "(V-1,) kg"),
            assign("STRETCH", _springs(EA, layout), "(V-2,) N/m"),
            assign("SHEAR", _springs(GA, layout), "(V-2,) N/m"),
            assign("BEND", bend, "(V-2,) N m/rad"),
            assign("TWIST", layout.GJ / layout.voronoi, "(V-2,) N m/rad"),
            assign("DAHL_EPS_MAX", strains, "(V-2,) rad: friction's largest moment over BEND"),
            assign("DAHL_TAU", decay, "(V-2,) rad, over which friction builds up"),
            assign("GRAVITY", rope.gravity, "m/s^2"),
            f"HELD = {layout.held}  # vertices held at end 0, end 1: 1 pinned, 2 clamped",
            f"RADIUS = {radius:.10g}  # m; Newton would take 0.1 m",
            BODY,
        ]
        return ExportResult(
            "\n".join(lines),
            {"rope.usda": curves(rope, radius, EA, GA)},
            tuple(lost),
        )


def _softened(
    rope: RopeDescription, layout: Layout, lost: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    weight = float(layout.masses.sum() * np.linalg.norm(rope.gravity))
    most = STIFF * (weight or float((layout.EI / layout.voronoi**2).max()))
    EA, GA = np.minimum(layout.EA, most), np.minimum(layout.GA, most)
    if (EA < layout.EA).any() or (GA < layout.GA).any():
        lost.append(
            f"EA and GA above {most:.4g} N: stiffer springs leave the solver, which works in "
            f"single precision, no digits for bending; the rope stretches by {1 / STIFF:.2%} "
            "under its own weight"
        )
    return EA, GA


def _springs(rigidity: np.ndarray, layout: Layout) -> np.ndarray:
    """Return (V-2,) a joint stands for the two half segments beside it, in series."""
    give = layout.lengths / rigidity / 2
    return 1 / (give[:-1] + give[1:])


def _segment_masses(layout: Layout) -> np.ndarray:
    """Return (V-1,) [kg] half of each node's mass; all of the outermost nodes'."""
    half = layout.masses / 2
    masses = half[:-1] + half[1:]
    masses[0] += half[0]
    masses[-1] += half[-1]
    return masses


def _xyzw(q: np.ndarray) -> np.ndarray:
    return np.roll(q, -1, axis=-1)


IMPORTS = """import argparse
import sys

import newton
import numpy as np
import warp as wp
"""

BODY = '''
SUBSTEP = 1 / 600  # s
ITERATIONS = 240  # fewer show a softer and longer rope
DRAG = 8.0  # 1/s on every velocity, so that the rope comes to rest; no property of the rope
REST = 5e-4  # m/s, a rope slower than this is at rest; single precision never gets to zero
LONGEST = 20.0  # s


def make_model(pose):
    """The rope in a pose: one capsule a segment, one joint an inner vertex."""
    builder = newton.ModelBuilder(gravity=wp.vec3(*GRAVITY))
    if DAHL_EPS_MAX.any():
        newton.solvers.SolverVBD.register_custom_attributes(builder)
    rod = newton.Rod(
        START_X[pose], quaternions=START_Q[pose], rest_points=REST_X, rest_quaternions=REST_Q,
        radius=RADIUS,
    )
    shape = newton.ModelBuilder.ShapeConfig(density=0.0, has_shape_collision=False)
    bodies, joints = builder.add_rod(
        rod=rod, cfg=shape, stretch_stiffness=1.0, shear_stiffness=1.0, bend_stiffness=1.0,
        twist_stiffness=1.0, wrap_in_articulation=False,
    )
    lengths = np.linalg.norm(np.diff(REST_X, axis=0), axis=1)
    last = len(bodies) - 1
    clamped = ([0] if HELD[0] == 2 else []) + ([last] if HELD[1] == 2 else [])
    for i, body in enumerate(bodies):
        mass = 0.0 if i in clamped else float(MASSES[i])
        around = mass * (lengths[i] ** 2 / 12 + RADIUS**2 / 4)
        along = mass * max(RADIUS, 0.1 * lengths[i]) ** 2 / 2
        inertia = np.diag([around, around, along])
        builder.body_mass[body] = mass
        builder.body_inv_mass[body] = 1 / mass if mass else 0.0
        builder.body_inertia[body] = wp.mat33(*inertia.ravel().tolist())
        inverse = np.diag(1 / np.diag(inertia)) if mass else np.zeros((3, 3))
        builder.body_inv_inertia[body] = wp.mat33(*inverse.ravel().tolist())
    for i, joint in enumerate(joints):
        first = builder.joint_qd_start[joint]  # shear, shear, stretch, bend, bend, twist
        springs = [SHEAR[i], SHEAR[i], STRETCH[i], BEND[i], BEND[i], TWIST[i]]
        builder.joint_target_ke[first : first + 6] = [float(k) for k in springs]
    for end, body in ((0, bodies[0]), (1, bodies[-1])):
        if HELD[end] == 1:
            half = lengths[-1 if end else 0] / 2
            joints = joints + [builder.add_joint_ball(
                parent=-1, child=body,
                parent_xform=wp.transform(wp.vec3(*START_X[pose][-1 if end else 0]),
                                          wp.quat_identity()),
                child_xform=wp.transform(wp.vec3(0.0, 0.0, half if end else -half),
                                         wp.quat_identity()),
            )]
    builder.color()
    model = builder.finalize(skip_all_validations=True)
    if DAHL_EPS_MAX.any():  # vbd:dahl_eps_max and vbd:dahl_tau, of all joints
        for name, values in (("dahl_eps_max", DAHL_EPS_MAX), ("dahl_tau", DAHL_TAU)):
            every = np.zeros(model.joint_count, dtype=np.float32)
            every[joints[: len(values)]] = values
            getattr(model.vbd, name).assign(every)
    return model, bodies, lengths


def vertices(state, bodies, lengths):
    """(V, 3) [m]: the ends of the segments, averaged where two meet."""
    q = state.body_q.numpy()[bodies].astype(float)
    axis = q[:, 3:]
    x, y, z, w = axis.T
    along = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=1)
    start, stop = q[:, :3] - along * lengths[:, None] / 2, q[:, :3] + along * lengths[:, None] / 2
    return np.vstack([start[:1], (start[1:] + stop[:-1]) / 2, stop[-1:]])


def settle(pose):
    """Vertices (V, 3) [m] at rest and the time [s] that took."""
    model, bodies, lengths = make_model(pose)
    solver = newton.solvers.SolverVBD(model, iterations=ITERATIONS)
    now, then, control = model.state(), model.state(), model.control()
    slower, time, calm, every = float(np.exp(-DRAG * SUBSTEP)), 0.0, 0, 30
    before = vertices(now, bodies, lengths)
    while time < LONGEST:
        for _ in range(every):
            now.clear_forces()
            solver.step(now, then, control, None, SUBSTEP)
            now, then = then, now
            now.body_qd.assign(now.body_qd.numpy() * slower)
        time += every * SUBSTEP
        shape = vertices(now, bodies, lengths)
        speed = np.abs(shape - before).max() / (every * SUBSTEP)
        before = shape
        if not np.isfinite(speed):
            sys.exit("the rope exploded; lower SUBSTEP")
        calm = calm + 1 if speed < REST else 0  # slow too at the turning point of a swing
        if calm > 4:
            return shape, time
    sys.exit(f"still moves at {speed:.2e} m/s after {LONGEST:g} s")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pose", type=int, default=0)
    parser.add_argument("--out", help="csv of the vertices at rest: x,y,z")
    options = parser.parse_args()
    wp.config.quiet = True
    shape, time = settle(options.pose)
    print(f"at rest after {time:.2f} s")
    if options.out:
        np.savetxt(options.out, shape, delimiter=",", header="x,y,z", comments="")
'''
