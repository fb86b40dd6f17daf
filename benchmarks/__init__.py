"""Longer proofs, run by name: each prints a table and writes JSON."""
