"""Standard errors by the scatter from clip to clip."""

import numpy as np

from ropefit.inference.clipwise import FEWEST, scatter

CLIPS, FRAMES = 12, 60


def fitted(rng: np.random.Generator, shared: float) -> tuple[float, np.ndarray | None]:
    """Return the error of a slope fitted to clips that share an error each, and what is told."""
    clip = np.repeat(np.arange(CLIPS), FRAMES)
    jacobian = np.stack([np.ones(len(clip)), np.tile(np.linspace(1, 2, FRAMES), CLIPS)], axis=1)
    noise = rng.normal(size=len(clip)) + shared * rng.normal(size=CLIPS)[clip] * jacobian[:, 1]
    step = np.linalg.lstsq(jacobian, noise, rcond=None)[0]
    return float(step[1]), scatter(jacobian, noise - jacobian @ step, clip, np.zeros((2, 2)))


def test_errors_that_last_for_a_clip_are_told():
    rng = np.random.default_rng(0)
    for shared in (0.0, 3.0):
        every = [fitted(rng, shared) for _ in range(300)]
        inside = np.mean([abs(error) < 1.96 * sd[1] for error, sd in every])
        assert 0.91 <= inside <= 0.985


def test_few_clips_tell_no_scatter():
    rows = np.repeat(np.arange(FEWEST - 1), 10)
    z = np.random.default_rng(1).normal(size=len(rows))
    assert scatter(np.ones((len(rows), 1)), z, rows, np.zeros((1, 1))) is None
