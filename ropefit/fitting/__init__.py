"""The fits behind `identify`, one file a solver and search: observations in, model out."""
