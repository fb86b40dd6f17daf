"""One file a subcommand, all of the same shape; see runs/protocol.py."""
