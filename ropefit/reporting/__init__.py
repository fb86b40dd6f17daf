"""Figures and the HTML report, one class a section."""
