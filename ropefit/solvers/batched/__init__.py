"""Equilibria of many ropes at once, as tensors on any device."""
