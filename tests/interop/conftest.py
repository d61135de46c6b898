"""What the tests against stacks of others share."""

import pytest

from tests.interop.peer import Bench, JsPeer, require_npm_canopen


@pytest.fixture(scope="session")
def npm_canopen():
    """The JavaScript package is installed."""
    require_npm_canopen()


@pytest.fixture
def bench(npm_canopen):
    """A wire with a JavaScript device that is not yet opened."""
    peer = JsPeer()
    yield Bench(peer)
    peer.close()
