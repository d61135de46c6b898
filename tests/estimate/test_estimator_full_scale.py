"""Full scale is known for what it is, whatever zero, gain and converter; a force from it is "at least"."""

import numpy as np
import pytest

from skinbus.estimate import Estimator, Quality
from skinbus.model import Arm, Cone, Radial, Transducer, grid

FULL_SCALE = 50e3
N = 16
TABLE = 20000.0 * np.exp(-((np.arange(64) / 24.0) ** 2))


def pressures_of(arm, counts):
    """Return the pressures of counts as the master's cycle computes them."""
    step = arm.patches[0].patch.transducer.step
    return (counts - arm.tactel_offset) * (step * arm.tactel_gain)


@pytest.mark.parametrize("law", [Cone(4e6), Radial(400e-6, TABLE, 0.8)])
@pytest.mark.parametrize(
    ("offset", "gain", "top", "converter"),
    [
        (0, 1.0, 0x7FFF, None),
        (100, 1.0, 0x7FFF, None),
        (-100, 1.0, 0x7FFF, None),
        (0, 1.01, 0x7FFF, None),
        (0, 0.987, 0x7FFF, None),
        (37, 1.0123, 0x7FF0, None),  # 12 bits of which the EDS does not know
        (37, 1.0123, 0x7FC0, 10),
    ],
)
def test_force_of_a_clipped_peak_is_not_the_clipped_one(law, offset, gain, top, converter):
    arm = Arm.single_patch(
        grid(4, 4, 0.010),
        law=law,
        transducer=Transducer(full_scale=FULL_SCALE, converter_bits=converter),
        offset=np.full(N, float(offset)),
        gain=np.full(N, gain),
    )
    step = arm.patches[0].patch.transducer.step
    d = np.hypot(arm.tactel_s - 0.0055, arm.tactel_a - 0.0045)
    force = 60.0 if isinstance(law, Cone) else 20.0
    true = law.pressure(d, force)
    counts = np.minimum(np.rint(true / (gain * step)) + offset, top)
    assert (counts == top).any()
    contacts = Estimator(arm, "fit").update(pressures_of(arm, counts), 0)
    assert len(contacts) == 1
    assert contacts.quality[0] & Quality.SATURATED
    assert contacts.force[0] == pytest.approx(force, rel=0.05)
