"""Measured ropes: identification, prediction and diagnosis on real recordings."""
