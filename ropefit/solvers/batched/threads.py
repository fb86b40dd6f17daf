"""The compiled loops of the dynamics with one clip a thread of a CUDA device; or one by one.

Their arrays have the clips as their first axis and store them as their last: threads beside each
other read places beside each other.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ropefit.rod.either import Array
from ropefit.solvers.dynamics.kernels.adjoint import adjoint_clip, make_pullback, pullback_of
from ropefit.solvers.dynamics.kernels.entries import SOURCES
from ropefit.solvers.dynamics.kernels.records import Drive, change_of, drive_of, rod_of
from ropefit.solvers.dynamics.kernels.simulate import make_scratch, scratch_of, simulate_clip
from ropefit.solvers.kernels.jit import helper, kernel, source_key

THREADS, FEWER_THREADS = 64, 16  # in a block; fewer where cores would have no block
SCRATCH_SHARE = 0.6  # of the free memory of a device that scratch may take
KEY = source_key(*SOURCES, Path(__file__))


@helper
def _simulate(k, rods, of, drives, v0, limit, xs, qs, forces, iterations, status, done, scratch):
    status[k], done[k] = simulate_clip(
        rod_of(rods, of[k]), drive_of(drives, k), v0[k], limit, xs[k], qs[k], forces[k],
        iterations[k], scratch_of(scratch, k),
    )  # fmt: skip


@helper
def _pull_back(k, rods, of, drives, v0, xs, qs, forces, gx, gq, out, scratch):
    adjoint_clip(
        rod_of(rods, of[k]), drive_of(drives, k), v0[k], xs[k], qs[k], forces[k], gx[k], gq[k],
        change_of(out, k, k), pullback_of(scratch, k),
    )  # fmt: skip


def tensor(rows: Array) -> Tensor:
    """Return an array (C, ...) as a float64 tensor without gradients, expanded as it is."""
    if isinstance(rows, Tensor):
        return rows.detach().double()
    distinct = rows[:1] if rows.strides[0] == 0 else rows
    return torch.tensor(distinct, dtype=torch.float64, device="cpu").expand(rows.shape)


def spread(rows: Tensor, device: torch.device) -> Tensor:
    """Return an array (C, ...) on a device, stored as (..., C).

    What is expanded over the clips is sent once, and stored once if it is of some size.
    """
    if rows.stride(0) == 0:
        rows = rows[:1].to(device).expand_as(rows)
        if rows.ndim > 2:
            return rows
    return rows.to(device).movedim(0, -1).contiguous().movedim(-1, 0)


def filled(shape: tuple[int, ...], value: float, device: torch.device) -> Tensor:
    """Return a float64 array (C, ...) of one value, stored as (..., C)."""
    count, *rest = shape
    return torch.full((*rest, count), value, dtype=torch.float64, device=device).movedim(-1, 0)


def run_simulate(clips: int, segments: int, arrays: tuple[Any, ...], device: torch.device) -> None:
    """Simulate C clips; arrays: the arguments of `entries.simulate_clips`, on the device."""
    _run(0, _makers(KEY)[0](segments), clips, arrays, device)


def run_pull_back(
    clips: int, steps: int, segments: int, arrays: tuple[Any, ...], device: torch.device
) -> None:
    """Pull gradients of C clips back; arrays: the arguments of `entries.adjoint_clips`."""
    _run(1, _makers(KEY)[1](steps, segments), clips, arrays, device)


def _run(which: int, one: Any, clips: int, arrays: tuple[Any, ...], device: torch.device) -> None:
    """Run a loop, with scratch like that of one clip; as many clips at once as have room."""
    # Ropes are looked up by clip, and `held` is one for all: they go along with every part.
    rods, of, drives, *others = arrays
    for part in _parts(clips, _bytes(one), device):
        count = part.stop - part.start
        scratch = _map(one, lambda a: _repeated(a, count, device))  # noqa: B023
        driven = Drive._make([*(field[part] for field in drives[:3]), drives.held])
        some = (_map(item, lambda a: a[part]) for item in others)  # noqa: B023
        _launch(which, count, (rods, of[part], driven, *some, scratch), device)


def _parts(clips: int, each: int, device: torch.device) -> Iterator[slice]:
    """Yield slices of the clips; each: bytes of scratch of one."""
    most = clips
    if device.type == "cuda":
        free = torch.cuda.mem_get_info(device)[0] + torch.cuda.memory_reserved(device)
        free -= torch.cuda.memory_allocated(device)
        most = max(int(SCRATCH_SHARE * free) // each, 1)
    for first in range(0, clips, most):
        yield slice(first, min(first + most, clips))


def _launch(which: int, clips: int, arguments: tuple[Any, ...], device: torch.device) -> None:
    if device.type != "cuda":
        _in_turn(KEY)[which](clips, *_map(arguments, lambda t: t.numpy()))
        return
    from numba import cuda

    index = torch.cuda.current_device() if device.index is None else device.index
    cores = torch.cuda.get_device_properties(index).multi_processor_count
    block = THREADS if clips >= THREADS * cores else FEWER_THREADS
    stream = torch.cuda.current_stream(index).cuda_stream
    with cuda.gpus[index]:
        same = cuda.external_stream(stream) if stream else 0
        run = _on_cuda(KEY)[which][-(-clips // block), block, same]
        run(clips, *_map(arguments, cuda.as_cuda_array))


@cache
def _makers(sources: int) -> tuple[Callable[..., Any], ...]:
    """Return what makes scratch for one clip, to simulate and to pull back; sources: see `jit`."""

    @kernel
    def scratch(segments):
        assert sources != 0
        return make_scratch(segments)

    @kernel
    def pullback(steps, segments):
        assert sources != 0
        return make_pullback(steps, segments)

    return scratch, pullback


@cache
def _in_turn(sources: int) -> tuple[Callable[..., None], ...]:
    """Return both loops over the clips of a part, on the CPU."""

    @kernel
    def simulate(clips, rods, of, drives, v0, limit, xs, qs, forces, counts, status, done, scratch):
        assert sources != 0
        for k in range(clips):
            _simulate(k, rods, of, drives, v0, limit, xs, qs, forces, counts, status, done, scratch)

    @kernel
    def pull_back(clips, rods, of, drives, v0, xs, qs, forces, gx, gq, out, scratch):
        assert sources != 0
        for k in range(clips):
            _pull_back(k, rods, of, drives, v0, xs, qs, forces, gx, gq, out, scratch)

    return simulate, pull_back


@cache
def _on_cuda(sources: int) -> tuple[Any, ...]:
    """Return both as kernels of a device, a thread a clip. Raises ImportError."""
    from numba import cuda

    grid: Any = cuda.grid

    @cuda.jit(cache=True)
    def simulate(clips, rods, of, drives, v0, limit, xs, qs, forces, counts, status, done, scratch):
        k = grid(1)
        if sources != 0 and k < clips:
            _simulate(k, rods, of, drives, v0, limit, xs, qs, forces, counts, status, done, scratch)

    @cuda.jit(cache=True)
    def pull_back(clips, rods, of, drives, v0, xs, qs, forces, gx, gq, out, scratch):
        k = grid(1)
        if sources != 0 and k < clips:
            _pull_back(k, rods, of, drives, v0, xs, qs, forces, gx, gq, out, scratch)

    return simulate, pull_back


def _map(item: Any, change: Callable[[Any], Any]) -> Any:
    """Return a record of arrays and records with every array changed; numbers stay."""
    if isinstance(item, tuple):
        parts = [_map(part, change) for part in item]
        return type(item)(*parts) if hasattr(item, "_fields") else tuple(parts)
    return item if isinstance(item, int) else change(item)


def _bytes(one: Any) -> int:
    return sum(map(_bytes, one)) if isinstance(one, tuple) else one.nbytes


def _repeated(array: np.ndarray, count: int, device: torch.device) -> Tensor:
    """Return `count` copies of an array, stored side by side."""
    there = torch.from_numpy(array).to(device)[..., None]
    return there.expand(*array.shape, count).contiguous().movedim(-1, 0)
