"""ropefit: turn recordings of real ropes into simulations that behave like them."""

__version__ = "0.1.0"
