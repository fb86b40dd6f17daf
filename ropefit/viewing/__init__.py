"""A run in other people's viewers; each is an extra, imported only when it is asked for."""
