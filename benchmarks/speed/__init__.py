"""Speed: against other implementations on the same work, and on accelerators."""
