"""How a state is found, and how that is differentiated. No physics here."""
