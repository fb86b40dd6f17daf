"""The rope inside one's own torch code: a stiffness profile along it, learned by gradient descent.

    python examples/learn_stiffness_in_torch.py

A rope whose second half is three times as stiff hangs in four poses; Adam finds the profile, as two
numbers, from the shapes alone. The gradient goes through the equilibrium by the implicit function
theorem: one linear solve, whatever the number of Newton iterations.
"""

import torch

import ropefit

torch.manual_seed(0)
ends = torch.zeros(4, 2, 3, dtype=torch.float64)
ends[:, 1, 0] = torch.tensor([0.3, 0.45, 0.6, 0.75])
ends[:, 1, 2] = torch.tensor([0.1, -0.1, 0.2, 0.0])
segments = 24


def shape(halves: torch.Tensor) -> torch.Tensor:
    """(4, 25, 3) m of a rope with EI of its two halves [N m²]."""
    EI = halves.repeat_interleave(segments // 2)
    return ropefit.Rope(length=1.0, mass=0.05, EI=EI, segments=segments)(ends)


truth = torch.tensor([5e-4, 1.5e-3], dtype=torch.float64)
seen = shape(truth)

log_EI = torch.full((2,), 1e-3, dtype=torch.float64).log().requires_grad_()
optimiser = torch.optim.Adam([log_EI], lr=0.1)
for step in range(80):
    optimiser.zero_grad()
    loss = (shape(log_EI.exp()) - seen).square().sum(-1).mean()
    loss.backward()
    optimiser.step()
    if step % 20 == 0:
        print(f"step {step:2d}: rms {1e3 * loss.item() ** 0.5:.4f} mm")

found = log_EI.exp().detach()
print(f"EI of the halves: {found[0]:.3e} and {found[1]:.3e} N m^2 (truth 5e-4 and 1.5e-3)")
assert torch.allclose(found, truth, rtol=0.02)
