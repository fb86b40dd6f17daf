"""Bodies that a rope in motion touches: where its nodes are put, and how that changes."""

import numpy as np

from ropefit.rod.bodies import change_pushed_out, pushed_out
from ropefit.rod.fields import BAR, NO_BODY, PLANE

SLOPE, AXIS = np.array([0.6, 0.0, 0.8]), np.array([0.0, 0.8, 0.6])  # unit vectors
BODIES = np.array(
    [
        [0.0, 0.0, -0.1, *SLOPE, 0.0, PLANE],
        [0.3, 0.1, 0.2, *AXIS, 0.05, BAR],
        [0.0] * 7 + [NO_BODY],
    ]
)


def nodes() -> np.ndarray:
    """Return (2, 7, 3) [m] of two clips: the second nodes in the plane, the third in the bar."""
    x = np.random.default_rng(0).uniform(0.5, 1.0, (2, 7, 3))
    x[:, 1] = [[0.1, 0.2, -0.3], [0.0, -0.1, -0.2]]
    x[:, 2] = BODIES[1, :3] + [[0.03, 0.08, 0.07], [-0.01, 0.2, 0.16]]
    x[:, 0] = x[:, 1]  # an end, which is held
    return x


def test_nodes_inside_are_put_on_the_surface():
    x = nodes()
    out = pushed_out(BODIES, x)
    np.testing.assert_allclose((out[:, 1] - BODIES[0, :3]) @ SLOPE, 0.0, atol=1e-15)
    far = np.linalg.norm(np.cross(out[:, 2] - BODIES[1, :3], AXIS), axis=-1)
    np.testing.assert_allclose(far, 0.05, rtol=1e-12)
    assert np.array_equal(out[:, [0, 3, 4, 5, 6]], x[:, [0, 3, 4, 5, 6]])


def test_what_moves_them_is_told_in_closed_form():
    """By the nodes, and by all that a body is described by, against central differences."""
    rng, x, step = np.random.default_rng(1), nodes(), 1e-5
    dbodies, dx = rng.normal(size=(1, 3, *BODIES.shape)), rng.normal(size=(2, 3, *x.shape[1:]))
    dbodies[..., 7] = 0.0
    found = change_pushed_out(BODIES, x, dbodies, dx)
    for p in range(3):
        f = [
            pushed_out(BODIES + k * step * dbodies[0, p], x + k * step * dx[:, p])
            for k in (-2, -1, 1, 2)
        ]
        wanted = (f[0] - 8 * f[1] + 8 * f[2] - f[3]) / (12 * step)
        np.testing.assert_allclose(found[:, p], wanted, rtol=1e-8, atol=1e-8)
    assert np.abs(found - dx.reshape(found.shape))[:, :, 1:3].min() > 1e-4
    assert np.array_equal(found[:, :, 3:], dx[:, :, 3:])
