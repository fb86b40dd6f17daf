"""The rod in motion: how it is stepped, and how that is differentiated."""
