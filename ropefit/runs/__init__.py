"""A run: its directory and lock, how a stage is executed in it, and what makes its output stale."""
