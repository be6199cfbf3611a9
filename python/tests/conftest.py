"""Files that the tests use."""

import os
import pathlib

import pytest

REPOSITORY = pathlib.Path(os.environ.get("SKILLBENCH_REPOSITORY", pathlib.Path(__file__).parents[2]))


@pytest.fixture(scope="session")
def files():
    """Made-up device files."""
    return REPOSITORY / "scripts" / "interop" / "files"


@pytest.fixture(scope="session")
def short():
    """An application of seven short motions."""
    return REPOSITORY / "bench" / "studies" / "src" / "explore" / "short.toml"
