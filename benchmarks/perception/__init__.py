"""Perception: `preprocess` on rendered frames and clouds of known ropes."""
