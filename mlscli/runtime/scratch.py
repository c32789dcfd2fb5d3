"""Room on disk for what does not fit into memory."""

from __future__ import annotations

import os
import tempfile
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mlscli.errors import OutputError
from mlscli.runtime.arrays import Array


class Scratch:
    """A temporary file that arrays are put away in; it goes with the program, however that ends.

    Parameters
    ----------
    folder : path, optional
        Where the file lies; the system's place for temporary files where none is given.

    Raises
    ------
    OutputError
        Where there is no such folder, or no file can be made in it.
    """

    def __init__(self, folder: str | os.PathLike[str] | None = None) -> None:
        self._folder = Path(folder or tempfile.gettempdir())
        self._lock = threading.Lock()
        self._size = 0
        try:
            # It has no name, or loses it when it is closed: nothing is left behind.
            self._file = tempfile.TemporaryFile(dir=self._folder, buffering=0)  # noqa: SIM115
        except OSError as error:
            raise self._failed(error) from error

    def __enter__(self) -> Scratch:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def put(self, array: Array) -> Stored:
        """Put an array away.

        Raises
        ------
        OutputError
            Where the disk is full.
        """
        data = np.ascontiguousarray(array).view(np.uint8).data
        with self._lock:
            offset = self._size
            self._file.seek(offset)
            try:
                while data:
                    data = data[self._file.write(data) :]
            except OSError as error:
                raise self._failed(error) from error
            self._size = self._file.tell()
        return Stored(self, array.dtype, offset)

    def read(self, dtype: np.dtype[Any], offset: int, size: int) -> Array:
        """Return `size` values that lie `offset` bytes from the beginning.

        Raises
        ------
        OutputError
            They lie there no more.
        """
        values = np.empty(size, dtype)
        data = values.view(np.uint8).data
        with self._lock:
            self._file.seek(offset)
            while data:
                if not (count := self._file.readinto(data)):
                    raise OutputError(f"{self._folder}: a temporary file has lost its end")
                data = data[count:]
        return values

    def _failed(self, error: OSError) -> OutputError:
        return OutputError(
            f"{self._folder}: no room for temporary files: {error.strerror or error}; "
            "`scratch` DIR names another place"
        )


@dataclass(frozen=True)
class Stored:
    """An array that was put away, of one dimension: slices of it are read."""

    scratch: Scratch
    dtype: np.dtype[Any]
    offset: int

    def __getitem__(self, part: slice) -> Array:
        return self.scratch.read(
            self.dtype, self.offset + part.start * self.dtype.itemsize, part.stop - part.start
        )
