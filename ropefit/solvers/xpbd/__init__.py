"""Algorithm 1 of the paper: the reference in torch, and compiled."""
