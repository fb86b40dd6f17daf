"""The mechanics of the rod: state, frames, strains, rest shape. No solver here."""
