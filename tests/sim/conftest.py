"""The arms that these tests act on."""

import pytest

from skinbus.config.system import load_arm
from skinbus.model import Arm


@pytest.fixture(scope="session")
def pad() -> Arm:
    return load_arm("pad")


@pytest.fixture(scope="session")
def forearm() -> Arm:
    return load_arm("forearm")
