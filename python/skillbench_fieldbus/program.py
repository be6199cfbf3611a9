"""The program that the wheel contains."""

import os
import pathlib


def bench() -> str:
    """Returns the path of `bench`: that of `SKILLBENCH_BENCH`, or the one beside this file."""
    given = os.environ.get("SKILLBENCH_BENCH")
    path = pathlib.Path(given) if given else pathlib.Path(__file__).parent / "bin" / "bench"
    if not os.access(path, os.X_OK):
        raise FileNotFoundError(f"{path}: not a program; install the wheel, or set SKILLBENCH_BENCH to the path of bench")
    return str(path)
