"""Rigs for the tests of the master."""

import pytest

from tests.master.rig import Rig


@pytest.fixture
def rig():
    return Rig("pad")


@pytest.fixture
def forearm():
    return Rig("forearm")
