"""Scene files: what ships loads, and every fault of a bad file is reported at once."""

import math

import pytest

from skinbus.sim import load_scene, scene_names
from skinbus.sim.scene_file import scene_of
from tests.files import faults_of, put
from tests.sim.truth import truth_of


@pytest.mark.parametrize("name", scene_names())
def test_scene_that_ships_loads_and_is_felt(name):
    scene = load_scene(name)
    assert scene.title
    for touch in scene.touches:
        middle = 0.5 * (touch.start + touch.end)
        assert len(scene.touches_at(middle)) >= 1
        assert truth_of(scene)(middle).max() > 1000.0


def test_constant_force_rises_and_falls_within_its_ramp(tmp_path):
    touch = '[[touch]]\nlink = "forearm"\ns_mm = 51\nangle_deg = 190\nforce_n = 8\n'
    scene = load_scene(
        put(
            tmp_path,
            "scene.toml",
            f'[scene]\narm = "forearm"\nduration_s = 10\n{touch}start_s = 1\nend_s = 2\nramp_s = 0.2\n',
        )
    )
    assert [scene.touches_at(t).force.tolist() for t in (0.9, 1.5, 2.0)] == [[], [8.0], []]
    assert scene.touches_at(1.1).force[0] == pytest.approx(4.0)
    radius = float(scene.arm.links[0].surface.radius)
    assert scene.touches_at(1.5).a[0] == pytest.approx(math.radians(-170) * radius)


BAD = """
[scene]
arm = "forearm"
duration_s = -10
sed = 3

[layer]
law = "elastic"
poisson = 0.5
thickness_mm = "6"

[[touch]]
link = "elbow"
s_mm = 51
angle_deg = 0
force_n = 5

[[touch]]
link = "forearm"
s_mm = 400
angle_deg = 0
force_n = 5
start_s = 3
end_s = 2

[[touch]]
link = "forearm"
s_mm = 50
force_n = [[0, 1], [2, -3], [1, 0]]

[[touch]]
link = "forearm"
path = [[0, 1, 2], [0, 1, 2]]
angle_deg = 3
force_n = 5
shape = "edge"
width_mm = 4

[[touch]]
link = "forearm"
s_mm = 51
angle_deg = 0
force_n = "5"
strength = 3

[[touch]]
link = "forearm"
s_mm = 51
angle_deg = 0
force_n = 5
inclination = 0.3
shape = "palm"
length_mm = 30
width_mm = 20

[effect.nois]
sigma_pa = 1

[effect.dead]
share = 2

[effect.stuck]
tactels = [[99, 1]]

[effects]
x = 1
"""


def test_every_fault_of_a_bad_scene_is_reported_at_once(tmp_path):
    faults = faults_of(load_scene, put(tmp_path, "bad.toml", BAD))
    wanted = [
        "scene.duration_s: is -10; wanted greater than 0",
        "scene.sed: is 3; wanted no such key; did you mean 'seed'?",
        "layer.poisson: is 0.5; wanted less than 0.5",
        "layer.thickness_mm: is '6'; wanted a number",
        "touch 1.link: is 'elbow'; wanted a link of arm forearm: forearm",
        "touch 2.s_mm: is 's 400.0, a 0.0 mm'; wanted on link forearm: s 0 to 154 mm",
        "touch 2.end_s: is 2.0; wanted later than the start, 3 s",
        "touch 3.angle_deg: wanted a value, or a path",
        "touch 3.force_n: is [0.0, 2.0, 1.0]; wanted times from 0 on that grow",
        "touch 3.force_n: is -3.0; wanted forces of 0 N or more",
        "touch 4.path: is [0.0, 0.0]; wanted times that grow",
        "touch 4.angle_deg: is 3.0; wanted nothing beside path",
        "touch 4.length_mm: wanted a value: the shape is edge",
        "touch 4.width_mm: is 4.0; wanted nothing: the shape is edge",
        "touch 5.force_n: is '5'; wanted a number",
        "touch 5.strength: is 3; wanted no such key",
        "touch.inclination: wanted the effect shear",
        "touch.inclination: is 0.3; wanted 0 of an edge or a palm",
        "effect.nois: wanted an effect; known are",
        "effect.dead.share: is 2; wanted less than or equal to 1",
        "effect.stuck.tactels: is 99; wanted node-IDs of arm forearm",
        "effects: wanted no such table; known are scene, layer, joint, touch, effect",
    ]
    assert len(wanted) == len(faults)
    for fault in wanted:
        assert any(said.startswith(fault) for said in faults), fault


@pytest.mark.parametrize(
    ("force", "said"),
    [
        ("x", "touch 1.force_n: is 'x'; wanted a number, or an array"),
        ([[0.0, "x"]], "touch 1.force_n[1][2]: is 'x'; wanted a number"),
    ],
)
def test_a_force_that_may_be_a_number_or_keys_is_one_fault_in_our_words(force, said):
    touch = {"link": "plate", "s_mm": 10.0, "a_mm": 0.0, "force_n": force}
    assert said in faults_of(scene_of, {"scene": {"arm": "pad", "duration_s": 1.0}, "touch": [touch]})
