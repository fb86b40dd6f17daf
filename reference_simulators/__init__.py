"""Simulators and reference solutions that are not ropefit's, for tests and benchmarks.

None of them uses ropefit, but two modules: `as_ropefit` states the reference problems in ropefit's
terms, and `energy_balance` checks ropefit's states by its energy. Not part of the wheel.
"""
