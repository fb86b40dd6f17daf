"""Algorithm 1 in compiled loops, and its adjoint."""
