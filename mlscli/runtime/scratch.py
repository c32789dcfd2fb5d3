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
from mlscli.runtime.notices import detail


class Scratch:
    """A temporary file for arrays; it disappears with the program, however that ends.

    Parameters
    ----------
    folder : path, optional
        Where the file lies; by default the system's folder for temporary files.

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
            # The file has no name, or is deleted when it is closed: nothing is left behind.
            self._file = tempfile.TemporaryFile(dir=self._folder, buffering=0)  # noqa: SIM115
        except OSError as error:
            raise self._failed(error) from error
        detail(f"{self._folder}: what memory has no room for is put into a file there")

    def __enter__(self) -> Scratch:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def put(self, array: Array) -> Stored:
        """Store an array of one dimension.

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
            Where the file has lost its end.
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
    """An array of one dimension in a temporary file; slices with both ends are read from it.

    Attributes
    ----------
    scratch : Scratch
    dtype : numpy.dtype
    offset : int
        Where it begins in the file, in bytes.
    """

    scratch: Scratch
    dtype: np.dtype[Any]
    offset: int

    def __getitem__(self, part: slice) -> Array:
        return self.scratch.read(
            self.dtype, self.offset + part.start * self.dtype.itemsize, part.stop - part.start
        )
