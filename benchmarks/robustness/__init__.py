"""Robustness: random ropes, damaged inputs, killed processes, many recordings, other versions."""
