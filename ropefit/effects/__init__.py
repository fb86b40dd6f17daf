"""The catalogue of what a model may have left out; one file an effect."""
