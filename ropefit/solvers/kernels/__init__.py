"""What the compiled loops of several solvers share."""
