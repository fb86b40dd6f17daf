"""The rod in equilibrium: how it is found, and how that is differentiated."""
