"""Contact has no small beginnings: planes and bars are proposed by where the data stop."""

from __future__ import annotations

import numpy as np
import torch

from ropefit.effects import ContactFriction, Obstacle, SupportPlane
from ropefit.effects.place import horizontal, middle_of
from ropefit.effects.support_plane import up_and_normal
from ropefit.inference.diagnosis.families import Family
from ropefit.inference.least_squares import Fit

DEEP = 2.0  # noise sd by which the nominal rope must sink below where the data stop
LOWER = (0.0, 0.001, 0.002, 0.004, 0.006)  # m below where the data stop, until the rope settles
UNEVEN, ODD = 5.0, 3.0  # standard errors: of a recording, of a frame in it
LIFTED = 2.5  # standard errors
SMOOTH = np.full(5, 0.2)  # of neighbouring stations
RADII = (0.03, 0.01)  # m: over a thick bar a rope comes to lie from farther away
ROUGH = 0.3  # coefficient of friction
NONE = np.zeros((1, 0))


Start = tuple[Family, np.ndarray]


def proposals(found: Fit) -> list[list[Start]]:
    """Families with the values (SI) from which their fits start, and others in case these do not
    settle; ropes held at both ends only."""
    if bool(torch.isnan(found.point.setup.ends).any()):
        return []  # a cantilever that lies on something has no smooth path there
    known = {term.name for term in found.forward.terms}
    planes = [] if SupportPlane.name in known else _planes(found)
    return [*_rough(found, known), *planes, *_bars(found)]


def _rough(found: Fit, known: set[str]) -> list[list[Start]]:
    """Friction on what is touched: it holds the rope back from the first frame on, and a small
    coefficient does not show what a large one does."""
    effect = ContactFriction()
    if effect.name in known or not effect.applies(found.point.setup):
        return []
    return [[(Family(effect, NONE), np.array([ROUGH]))]]


def uneven(found: Fit) -> bool:
    """Whether some frames are left far worse than the usual one."""
    return bool((_excess(found) > UNEVEN).any())


def _excess(found: Fit) -> np.ndarray:
    """(F,) standard errors by which the frames' mean squares are above the usual one's."""
    s, frames = found.stations, len(found.point.seen)
    square = (found.z.reshape(len(s.frame), -1) ** 2).mean(axis=1)
    count = np.bincount(s.frame, minlength=frames)
    mean = np.bincount(s.frame, square, frames) / np.maximum(count, 1)
    usual = float(np.median(mean[count > 0]))
    spread = np.sqrt(2 / np.maximum(count * s.residual.shape[1], 1))
    return np.where(count > 0, (mean / usual - 1) / spread, 0.0)


def _planes(found: Fit) -> list[list[Start]]:
    """A plane under the lowest stations of all frames, where the fitted rope sinks below it."""
    s, setup = found.stations, found.point.setup
    up = -(setup.gravity / setup.gravity.norm()).numpy()
    origin = middle_of(setup).numpy()
    place = _nodes(found)
    model = np.einsum("fka,a->fk", place - origin, up)
    if len(s.frame) == 0:
        return []
    height = (s.places(place) + _moves(found) - origin) @ up
    noise = float(np.sqrt(np.trace(s.white().mean(axis=0)) / 2)) + 1e-4
    lowest = np.array(
        [height[s.frame == t].min() if (s.frame == t).any() else np.inf for t in range(len(place))]
    )
    floor = float(np.quantile(lowest[np.isfinite(lowest)], 0.05))
    if model.min() > floor - DEEP * noise:
        return []
    return [[(Family(SupportPlane(), NONE), np.array([floor, 0.0, 0.0]))]]


def _nodes(found: Fit) -> np.ndarray:
    """(F, K, 3) [m] where the nodes are, not where a camera that is off sees them: a plane a few
    millimetres lower is none."""
    return np.where(np.isnan(found.point.seen), np.nan, found.point.solution.x)


def _moves(found: Fit) -> np.ndarray:
    """(M, 3) [m] from the fitted rope to the data at the stations."""
    return np.einsum("md,mda->ma", found.stations.residual, found.stations.basis)


def _bars(found: Fit) -> list[list[Start]]:
    """A bar under the place in space where the data of the odd frames lie above the fitted rope."""
    s, setup = found.stations, found.point.setup
    up = -(setup.gravity / setup.gravity.norm()).numpy()
    origin = middle_of(setup).numpy()
    move = _moves(found)
    data, lift = s.places(_nodes(found)) + move, np.zeros(len(s.frame))
    for t in np.flatnonzero(_excess(found) > ODD):
        mine = s.frame == t
        if mine.sum() >= len(SMOOTH):
            lift[mine] = np.convolve(move[mine] @ up, SMOOTH, mode="same")
    noise = float(np.sqrt(np.trace(s.white().mean(axis=0)))) + 1e-4
    if lift.max() < LIFTED * noise * np.linalg.norm(SMOOTH):
        return []
    lifted = lift > 0.7 * lift.max()
    centre = np.average(data[lifted], axis=0, weights=lift[lifted])
    away = np.average(move[lifted], axis=0, weights=lift[lifted])  # of a steep rope not upwards
    away /= np.linalg.norm(away)
    family, heading = Family(Obstacle(), NONE), _heading(found)
    under = [(way, r, r + d) for way in (away, up) for r in RADII for d in LOWER]
    return [[(family, np.array([*(centre - origin - d * way), r, heading])) for way, r, d in under]]


def bars_under(found: Fit, height: float, slopes: np.ndarray) -> list[list[Start]]:
    """Bars that touch a fitted rope where the plane that it was fitted with bears most of it: what
    rests on a bar in few frames rests as well, or nearly, on a slope."""
    setup = found.point.setup
    up, normal = (v.numpy() for v in up_and_normal(setup, *torch.from_numpy(slopes)))
    place = _nodes(found) - middle_of(setup).numpy()
    depth = np.maximum(-((place - height * up) @ normal), 0.0)
    most = int(depth.sum(axis=1).argmax())
    if not depth[most].any():
        return []
    centre = np.average(place[most], axis=0, weights=depth[most])
    family, heading = Family(Obstacle(), NONE), _heading(found)
    return [[(family, np.array([*(centre - r * normal), r, heading]))] for r in RADII]


def _heading(found: Fit) -> float:
    """[rad] of an axis across the line of the ends."""
    setup = found.point.setup
    up = -(setup.gravity / setup.gravity.norm()).numpy()
    first, second = (v.numpy() for v in horizontal(setup.gravity))
    span = np.nan_to_num(setup.ends[:, 0].numpy() - setup.ends[:, 1].numpy()).mean(0)
    across = np.cross(span, up)
    turn = float(np.arctan2(across @ second, across @ first))
    return (turn + np.pi / 2) % np.pi - np.pi / 2  # an axis has no direction
