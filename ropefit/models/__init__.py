"""Models of a rope: what they are fitted by, what they predict, and its derivatives."""
