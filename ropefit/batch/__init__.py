"""Many recordings: each a task of its own, run here or on a cluster, told in one table."""

from ropefit.batch.run import run_batch

__all__ = ["run_batch"]
