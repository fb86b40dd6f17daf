"""Arrays that are put aside, in a file of the process's own."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import BinaryIO

import numpy as np


@dataclass(frozen=True)
class Spilled:
    """An array that lies in a file, from `start` on, and not in memory."""

    file: BinaryIO
    start: int
    dtype: np.dtype
    shape: tuple[int, ...]

    @staticmethod
    def of(value: np.ndarray, file: BinaryIO) -> Spilled:
        """Put an array at the end of a file. Raises OSError."""
        start = file.seek(0, os.SEEK_END)
        file.write(np.ascontiguousarray(value).reshape(-1).view(np.uint8).data)
        return Spilled(file, start, value.dtype, value.shape)

    @property
    def nbytes(self) -> int:
        return int(np.prod(self.shape, dtype=np.int64)) * self.dtype.itemsize

    def load(self) -> np.ndarray:
        """Return the array. Raises OSError."""
        self.file.seek(self.start)
        read = bytearray(self.file.read(self.nbytes))
        if len(read) != self.nbytes:
            raise OSError("what was put aside is gone")
        return np.frombuffer(read, self.dtype).reshape(self.shape)
