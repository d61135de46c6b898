"""What users read of a wrong table: their keys, plain words, and the key that they may have meant."""

import pytest

from skinbus.config.arm_file import check_tables
from skinbus.errors import ConfigError
from skinbus.sim.scene_file import scene_of

LINK = {"name": "pad", "surface": "plane", "length_mm": 60.0, "width_mm": 60.0}
PATCH = {"link": "pad", "node_id": 1, "s_mm": 30.0}
TOUCH = {"link": "plate", "s_mm": 10.0, "a_mm": 0.0, "shape": "disc", "diameter_mm": 5.0, "force_n": 1.0}


def said_of_arm(tmp_path, **tables):
    usual = {"arm": {"name": "x"}, "link": [LINK], "patch": [PATCH]}
    return [str(fault) for fault in check_tables(usual | tables, tmp_path / "arm.toml").faults]


def said_of_touch(**changes):
    tables = {"scene": {"arm": "pad", "duration_s": 1.0}, "touch": [TOUCH | changes]}
    with pytest.raises(ConfigError) as refused:
        scene_of(tables)
    return [str(fault) for fault in refused.value.faults]


def test_an_unknown_table_is_answered_with_the_nearest(tmp_path):
    (said,) = said_of_arm(tmp_path, lnik=[LINK])
    assert "did you mean 'link'?" in said


def test_a_force_that_may_be_a_number_or_keys_is_one_fault_in_our_words():
    (said,) = said_of_touch(force_n="x")
    assert said == "touch 1.force_n: is 'x'; wanted a number, or an array"
    said = said_of_touch(force_n=[[0.0, "x"]])
    assert "touch 1.force_n[1][2]: is 'x'; wanted a number" in said
    assert "tuple" not in " ".join(said)


def test_a_misspelt_key_of_a_touch_and_of_an_effect():
    assert "did you mean 'force_n'?" in " ".join(said_of_touch(force_m=1.0))
    tables = {"scene": {"arm": "pad", "duration_s": 1.0}, "effect": {"nois": {}}}
    with pytest.raises(ConfigError, match="did you mean 'noise'"):
        scene_of(tables)
