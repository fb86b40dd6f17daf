"""Accuracy: against closed forms, boundary-value solutions, known truths and other simulators."""
