"""One file a subcommand, all of the same shape; see stage.py."""
