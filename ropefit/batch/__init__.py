"""Many recordings: each a task of its own, run here or on a cluster, listed in one table."""

from ropefit.batch.records import Batch
from ropefit.batch.run import run_batch

__all__ = ["Batch", "run_batch"]
