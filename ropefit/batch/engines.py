"""Where tasks run: in processes of this machine, or on the workers of a dask scheduler."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from typing import Protocol

from ropefit.batch.records import State
from ropefit.batch.task import Task, run_task
from ropefit.errors import RopefitError, StageFailed, WrongUsage
from ropefit.runs.threads import processors

Result = tuple[str, State, str]
CONNECT_SECONDS = 10  # to wait for a scheduler, and for its first worker


class WorkerDied(Exception):
    """A process that computed a task is gone; which one, only the records can tell."""


class Engine(Protocol):
    """Runs tasks, as many at a time as it has workers."""

    def run(self, tasks: list[Task]) -> Iterator[Result]:
        """Yield results as they come. Raises WorkerDied."""
        ...


class Local:
    """Processes on this machine; each is used for many recordings."""

    def __init__(self, workers: int | None = None):
        self.workers = workers or processors()

    def run(self, tasks: list[Task]) -> Iterator[Result]:
        from joblib import Parallel, delayed, parallel_config
        from joblib.externals.loky.process_executor import BrokenProcessPool

        workers = min(self.workers, len(tasks))
        threads = max(processors() // max(workers, 1), 1)
        with parallel_config(backend="loky", inner_max_num_threads=threads):
            # With one worker joblib would compute in this process, which must outlive its tasks:
            # it gets two, and never more than one task.
            pool = Parallel(
                n_jobs=max(workers, 2),
                pre_dispatch=workers,  # type: ignore[arg-type]
                batch_size=1,  # type: ignore[arg-type]
                return_as="generator_unordered",
            )
            try:
                yield from pool(delayed(run_task)(task) for task in tasks)  # type: ignore[misc]
            except BrokenProcessPool as error:
                raise WorkerDied from error


class Dask:
    """Workers of a dask scheduler: they must see the same folders and have the same ropefit."""

    def __init__(self, scheduler: str | None):
        if scheduler is None:
            raise WrongUsage(
                "--engine dask needs the address of its scheduler: --scheduler ADDRESS"
            )
        try:
            import distributed  # noqa: F401
        except ImportError:
            raise RopefitError("--engine dask needs dask: pip install 'ropefit[cluster]'")
        self.scheduler = scheduler

    def run(self, tasks: list[Task]) -> Iterator[Result]:
        # Not through joblib: with a single worker it would compute in this process.
        from distributed import Client, as_completed
        from distributed.comm.core import CommClosedError
        from distributed.scheduler import KilledWorker

        with ExitStack() as stack:
            try:
                client = stack.enter_context(
                    Client(self.scheduler, timeout=CONNECT_SECONDS, set_as_default=False)
                )
                client.wait_for_workers(1, timeout=CONNECT_SECONDS)
                futures = client.map(run_task, tasks, pure=False)
                for _, result in as_completed(futures, client.loop, with_results=True):
                    yield result
            except KilledWorker as error:
                raise WorkerDied from error
            except (OSError, CommClosedError, TimeoutError) as error:
                raise StageFailed(
                    f"scheduler {self.scheduler}: no answer or no workers "
                    f"({type(error).__name__}); start them and run the same command to go on"
                )
