"""Fitting: minimisation, grid search, uncertainty, control. Knows rods and losses, no files."""
