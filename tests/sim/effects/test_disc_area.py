"""disc_area: sets the disc over which tactels average, whatever the layer has by itself."""

import numpy as np

from skinbus.sim.effects.disc_area import DiscArea
from skinbus.sim.laws import ConeSettings, Elastic
from skinbus.sim.sampler import Sampler
from skinbus.sim.scene import Scene
from skinbus.sim.touch import Touch


def peak(arm, layer, effects=()):
    touch = Touch(link=0, path=np.array([[0.0, 0.030, 0.005]]), force=np.array([[0.0, 5.0], [1.0, 5.0]]))
    sampler = Sampler(Scene("test", arm, duration_s=1.0, layer=layer, touches=[touch], effects=effects))
    sampler.sample(0.5)
    return sampler.pressures.max(), sampler.pressures


def test_sets_the_diameter_of_every_tactel(mount):
    assert (mount(DiscArea(diameter_mm=7.0)).diameter == 7e-3).all()


def test_diameter_of_the_board_is_the_default_of_the_elastic_layer(pad):
    np.testing.assert_array_equal(
        peak(pad, Elastic())[1], peak(pad, Elastic(), [DiscArea(diameter_mm=9.53)])[1]
    )


def test_larger_discs_read_lower_peaks(pad):
    for layer in (Elastic(tactel="point"), ConeSettings(slope_pa_per_m=4e6)):
        peaks = [peak(pad, layer, [DiscArea(diameter_mm=d)])[0] for d in (0.0, 4.0, 8.0, 12.0)]
        assert peaks == sorted(peaks, reverse=True)
        assert peaks[-1] < 0.8 * peaks[0]


def test_zero_diameter_is_the_point_tactel(pad):
    points = peak(pad, Elastic(tactel="point"))[1]
    np.testing.assert_array_equal(peak(pad, Elastic(), [DiscArea(diameter_mm=0.0)])[1], points)
