"""Fixtures of pytest."""

import pytest

from .cable import Cable, Interface


def pytest_addoption(parser):
    group = parser.getgroup("skillbench-fieldbus")
    group.addoption(
        "--fieldbus-interface", metavar="IF", default=None, help="interface of fieldbus_end, in place of a namespace of its own"
    )


@pytest.fixture
def fieldbus_cable():
    """Two ends of a cable in network namespaces, gone after the test."""
    with Cable() as cable:
        yield cable


@pytest.fixture
def fieldbus_end(request):
    """The interface of --fieldbus-interface, where a device or a controller is; without the option, the first end of a cable."""
    name = request.config.getoption("--fieldbus-interface")
    if name is not None:
        yield Interface(name).end
    else:
        yield request.getfixturevalue("fieldbus_cable").ends[0]
