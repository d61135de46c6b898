"""A sensor that is not there: in the second half of each minute a finger goes round on 16 tactels.

skinbus board new --grid 4x4 --pitch-mm 10 --bits 16 --out pad.eds
skinbus patch pad.eds --reader made_up_pad:read --node 5 --interface udp_multicast

`skinbus board check` wants a board that nothing presses: begin it with the patch, with --syncs 400.
"""

import time

import numpy as np
import numpy.typing as npt

START_S = time.monotonic()
v, u = np.divmod(np.arange(16), 4) - np.array([[1.5], [1.5]])  # in pitches from the middle of 4 x 4 tactels


def read() -> npt.NDArray[np.float64]:
    """Return counts (16,): 32767 is full scale."""
    t_s = time.monotonic() - START_S
    distance2 = (u - np.cos(t_s)) ** 2 + (v - np.sin(t_s)) ** 2
    return np.asarray(8000.0 * np.exp(-distance2) * (t_s % 60 > 30))
