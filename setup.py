"""Compiles the kernels when the package is built; all else stands in pyproject.toml.

It does so where numba and numpy are there, as they are where pip builds. Without them, and for
other versions than these, the program compiles its kernels itself when it first calls them.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import ClassVar

from setuptools import Command, Distribution, setup
from setuptools.command.build import build

KERNELS = Path("mlscli", "runtime", "compiled")
# In a process of its own: setuptools is imported in this one, the package it builds in that one.
COMPILE = """
import os
from mlscli.runtime.warming import warm_up
warmed = warm_up(len(os.sched_getaffinity(0)))
print(f"{warmed.compiled} kernels compiled, {warmed.present} were there", *warmed.failed, sep="\\n")
"""


class BuildKernels(Command):
    """Compile all kernels into the package that was built, or into the tree (editable)."""

    user_options: ClassVar[list[tuple[str, str | None, str]]] = []

    def initialize_options(self) -> None:
        """Say what setuptools will set."""
        self.build_lib: str | None = None
        self.editable_mode = False

    def finalize_options(self) -> None:
        """Learn where the package is built."""
        self.set_undefined_options("build_py", ("build_lib", "build_lib"))

    def run(self) -> None:
        """Compile; that it cannot be done is no reason not to install."""
        place = Path.cwd() if self.editable_mode else Path(str(self.build_lib)).resolve()
        if not self.editable_mode:
            # An earlier build may have left others.
            shutil.rmtree(place / KERNELS, ignore_errors=True)
        others = os.environ.get("PYTHONPATH")
        found = os.pathsep.join([str(place), others] if others else [str(place)])
        environment = {**os.environ, "PYTHONPATH": found}
        environment.pop("NUMBA_CACHE_DIR", None)
        if subprocess.call([sys.executable, "-c", COMPILE], env=environment, cwd=place):
            self.announce("kernels were not compiled: the program will, when it calls them", 3)

    def get_source_files(self) -> list[str]:
        """Return what else belongs into an sdist: nothing."""
        return []

    def get_outputs(self) -> list[str]:
        """Return the files of the package that this has made."""
        made = [] if self.editable_mode else Path(str(self.build_lib), KERNELS).glob("*")
        return sorted(map(str, made))

    def get_output_mapping(self) -> dict[str, str]:
        """Return which of these stand for files of the tree: none."""
        return {}


class Compiled(Distribution):
    """A package for one version of Python and one platform."""

    def has_ext_modules(self) -> bool:
        """Have the wheel named by the version of Python and the platform."""
        return True


build.sub_commands = [*build.sub_commands, ("build_kernels", None)]
setup(
    cmdclass={"build_kernels": BuildKernels},
    distclass=Compiled,
    # Pip asks for these beside what pyproject.toml names, and takes the newest.
    setup_requires=["numba>=0.60", "numpy>=1.26"],
)
