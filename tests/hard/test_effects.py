"""Effects of a real skin with the law that ships: contacts are true within what they say, or flagged.

Fingers press and let go in random places of the arm "pad"; the master runs as it is delivered.
"""

import numpy as np
import pytest

import skinbus
from skinbus.estimate import Quality
from tests.files import put
from tests.hard.check import SIGMAS

PITCH = 6.0e-3
"""m, of the board: a touch without a contact this near is missed."""
SEED = 20261122
N_TOUCHES = 8
MOST_MISSED = 0.05
"""Of the cycles with a touch: the first one of a touch that lands may not do yet."""
MARGIN_MM = 8.0
"""From the rim of the board, so that what is measured is the effect."""
DISC = 'shape = "disc"\ndiameter_mm = 12.0\n'
EFFECTS = {
    "nothing else": (DISC, ""),
    "inclined push": (f"{DISC}inclination = 0.3\ndirection_deg = 40.0", "[effect.shear]"),
    "growing contact": ('shape = "sphere"\ndiameter_mm = 16.0', ""),
    "impact": (f"{DISC}impact_n = 20.0\nimpact_ms = 10.0", ""),
    "burst": (DISC, "[effect.burst]\nper_minute = 120.0"),
    "zeros move": (DISC, "[effect.thermal]\nend_c = 4.0\ntau_s = 60.0"),
    "zeros move in a touch": (DISC, "[effect.thermal]\nend_c = 3.0\ntau_s = 25.0\nboard_sigma_c = 0.0"),
}
"""A touch, and what the scene has beside noise."""
# Zeros are what "zeros move in a touch" is about, and they are held by the same code at every level.
CASES = [(name, level) for name in EFFECTS for level in ("fit", "full")]
CASES.remove(("zeros move in a touch", "full"))


def scene_of(name):
    """A scene file with touches at random places under an effect."""
    shape, effects = EFFECTS[name]
    rng, text = np.random.default_rng(SEED), ""
    n, on_s, off_s = (1, 25.0, 1.0) if name == "zeros move in a touch" else (N_TOUCHES, 0.5, 0.4)
    for k in range(n):
        s, a = rng.uniform(MARGIN_MM, 50.0 - MARGIN_MM), rng.uniform(MARGIN_MM - 25.0, 25.0 - MARGIN_MM)
        begin = 1.0 + k * (on_s + off_s)
        text += (
            f'[[touch]]\nlink = "plate"\n{shape}\ns_mm = {s:.2f}\na_mm = {a:.2f}\n'
            f"force_n = {rng.uniform(2.0, 10.0):.2f}\nstart_s = {begin:.3f}\nend_s = {begin + on_s:.3f}\n"
        )
    duration_s = begin + on_s + 0.5
    head = f'[scene]\ntitle = "{name}"\narm = "pad"\nseed = {SEED}\nduration_s = {duration_s:.1f}\n'
    return f"{head}{text}{effects}\n[effect.noise]\n"


@pytest.mark.slow
@pytest.mark.parametrize(("name", "level"), CASES)
def test_contacts_are_within_six_sd_or_flagged(name, level, tmp_path):
    scene = put(tmp_path, "scene.toml", scene_of(name))
    n_touches = n_missed = 0
    with skinbus.simulate(scene, level=level) as skin:
        for cycle in skin:
            seen = [contact for contact in cycle.contacts if contact.seen_ns == cycle.t_ns]
            for touch in cycle.truth:
                if touch.force <= 0.5:
                    continue
                near = [c for c in seen if np.hypot(c.s - touch.s, c.a - touch.a) <= PITCH]
                n_touches += 1
                n_missed += not near
                for contact in (c for c in near if c.quality == Quality.GOOD):
                    off = np.array([contact.s - touch.s, contact.a - touch.a, contact.force - touch.force])
                    assert (np.abs(off) <= SIGMAS * np.sqrt(np.diag(contact.covariance))).all(), contact
    assert n_touches > 300
    assert n_missed <= MOST_MISSED * n_touches
