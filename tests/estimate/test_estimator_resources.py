"""What an estimator works on is its own: kernels allocate nothing, and a copy would write to it."""

import copy
import pickle

import numpy as np
import pytest
from numba.core.errors import NumbaError

from skinbus.estimate import Estimator
from skinbus.jit import kernel
from tests.skins import PAD


def test_kernels_cannot_allocate():
    @kernel
    def greedy(n):
        return np.zeros(n).sum()

    with pytest.raises(NumbaError, match="zeros"):
        greedy(3)


@pytest.mark.parametrize("copied", [copy.deepcopy, pickle.dumps])
def test_an_estimator_is_not_copied(copied):
    with pytest.raises(TypeError, match="make another Estimator"):
        copied(Estimator(PAD))
