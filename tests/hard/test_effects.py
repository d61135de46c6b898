"""Effects of a real skin with the law that ships: contacts are true within what they say, or flagged.

Fingers press and let go in random places of boards; the master runs as it is delivered.
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


def write_scene(folder, name):
    """Write a scene with a touch at a random place of each board under an effect; return its path."""
    shape, effects = EFFECTS[name]
    rate_hz, end_s = (12.5, 26.0) if name == "zeros move in a touch" else (100.0, 1.5)
    rng, arm, scene = np.random.default_rng(SEED), f'[arm]\nname = "boards"\nrate_hz = {rate_hz}\n', ""
    arm += f'[[link]]\nname = "plate"\nsurface = "plane"\nlength_mm = {100.0 * N_TOUCHES}\nwidth_mm = 50.0\n'
    for k in range(N_TOUCHES):
        arm += f'[[patch]]\nnode_id = {k + 1}\nlink = "plate"\n'
        arm += f's_mm = {100.0 * k + 50.0}\neds = "skin-patch"\n'
        s, a = rng.uniform(MARGIN_MM, 50.0 - MARGIN_MM), rng.uniform(MARGIN_MM - 25.0, 25.0 - MARGIN_MM)
        scene += (
            f'[[touch]]\nlink = "plate"\n{shape}\ns_mm = {100.0 * k + 25.0 + s:.2f}\na_mm = {a:.2f}\n'
            f"force_n = {rng.uniform(2.0, 10.0):.2f}\nstart_s = 1.0\nend_s = {end_s}\n"
        )
    put(folder, "arm.toml", arm)
    head = f'[scene]\ntitle = "{name}"\narm = "arm.toml"\nseed = {SEED}\nduration_s = {end_s + 0.5}\n'
    return put(folder, "scene.toml", f"{head}{scene}{effects}\n[effect.noise]\n")


@pytest.mark.slow
@pytest.mark.parametrize(("name", "level"), CASES)
def test_contacts_are_within_six_sd_or_flagged(name, level, tmp_path):
    scene = write_scene(tmp_path, name)
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
