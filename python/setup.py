"""The wheel contains a program of one processor, and no module of Python's own interface."""

import os
import platform

from setuptools import setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.dist import Distribution


class ProgramWheel(bdist_wheel):
    """A wheel for any Python 3 on Linux with this processor."""

    def get_tag(self):
        machine = os.environ.get("SKILLBENCH_WHEEL_MACHINE") or platform.machine()
        return "py3", "none", f"linux_{machine}"


class WithProgram(Distribution):
    def has_ext_modules(self):
        return True


setup(version=os.environ["SKILLBENCH_VERSION"], cmdclass={"bdist_wheel": ProgramWheel}, distclass=WithProgram)
