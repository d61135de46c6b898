"""Settings of a patch: objects by name or index, every fault said, lint and limits applied."""

import pytest

from skinbus.config.system import load_arm, ods_of
from skinbus.errors import EdsError
from skinbus.objects import cia, profile
from skinbus.objects.board import describe_patch
from skinbus.objects.eds import find_eds, load_eds
from skinbus.objects.settings import freeze
from tests.files import faults_of, put


def load(**settings):
    return load_eds("skin-patch", 5, settings=freeze(settings))


# name, value, index, sub, what the object then holds
GOOD = [
    ("Touch Pa", 1500, 0x2030, 1, 1500),
    ("Thresholds/Touch Pa", 1500, 0x2030, 1, 1500),
    ("0x2030:01", 1500, 0x2030, 1, 1500),
    ("0x2030:1", "0x5DC", 0x2030, 1, 1500),
    ("Noise Pa", 150, 0x2030, 3, 150.0),
    ("Noise Pa", 150.5, 0x2030, 3, 150.5),
    ("Healthy tactels", 0xFFFE, 0x2040, 0, 0xFFFE),
    ("0x2040", 0xFFFE, 0x2040, 0, 0xFFFE),
    ("Producer heartbeat time", 100, 0x1017, 0, 100),
    ("Analogue input global interrupt enable", True, 0x6423, 0, 1),
    ("0x1800:01", "$NODEID+0x40000200", 0x1800, 1, 0x40000205),
    ("0x2012:10", -3, 0x2012, 16, -3),
]


@pytest.mark.parametrize(("name", "value", "index", "sub", "held"), GOOD)
def test_setting_becomes_the_parameter_value_and_leaves_the_default(name, value, index, sub, held):
    plain, od = load_eds("skin-patch", 5), load(**{name: value})
    variable = od.get_variable(index, sub)
    assert variable.value == held
    assert variable.default == plain.get_variable(index, sub).default


def test_array_is_set_as_a_whole():
    gains = [1.0 + 0.01 * k for k in range(16)]
    patch = describe_patch(load(**{"Tactel gain": gains}))
    assert patch.gain == pytest.approx(gains)


# name, value, what is said
BAD = [
    ("Tuch Pa", 1, "set.\"Tuch Pa\": wanted a name in the file such as 'Touch Pa'"),
    ("zzz", 1, 'set."zzz": wanted a name in the file, or an index such as 0x2030:01'),
    ("0x2999:01", 1, 'set."0x2999:01": wanted an object that exists'),
    ("0x2030:09", 1, 'set."0x2030:09": wanted an object that exists'),
    ("Tactel count", 4, 'set."Tactel count": is 4; wanted an object that can be written; [2000sub1] is ro'),
    ("Touch Pa", -1, 'set."Touch Pa": is -1; wanted UNSIGNED32: 0 to 4294967295'),
    ("Touch Pa", 1.5, 'set."Touch Pa": is 1.5; wanted UNSIGNED32: 0 to 4294967295'),
    ("Touch Pa", "much", "set.\"Touch Pa\": is 'much'; wanted UNSIGNED32: 10, 0x0A or 012"),
    ("Touch Pa", [1, 2], 'set."Touch Pa": is (1, 2); wanted one value'),
    ("Tactel gain", 1.0, 'set."Tactel gain": is 1.0; wanted a list of 16 values'),
    ("Tactel gain", [1.0], 'set."Tactel gain": is (1.0,); wanted a list of 16 values'),
    ("Noise Pa", float("inf"), 'set."Noise Pa": is inf; wanted a finite number'),
    ("Thresholds", 3, 'set."Thresholds": is 3; wanted a list of 5 values'),
    (
        "Synchronous counter overflow value",
        250,
        "[1019] ParameterValue: is 250; wanted at most 240, the high limit",
    ),
    ("COB-ID used by TPDO", 1, "wanted a name of one object; it may be 0x1800:01 or 0x1801:01"),
    ("0x1801:01", "$NODEID+0x180", "[1801sub1] ParameterValue: is '$NODEID+0x180'; wanted another"),
    ("0x1A00:00", 9, "[1A00sub0] ParameterValue: is 9; wanted at most 8, the high limit"),
    ("0x1A00:01", 0x20120110, "wanted an object with PDOMapping=1, not [2012sub1]"),
]


@pytest.mark.parametrize(("name", "value", "said"), BAD)
def test_what_cannot_be_set_is_said(name, value, said):
    with pytest.raises(EdsError) as caught:
        load(**{name: value})
    assert said in str(caught.value)


ARM = """
[arm]
name = "test"
[[link]]
name = "plate"
surface = "plane"
length_mm = 200.0
width_mm = 60.0
[[patch]]
node_id = 1
link = "plate"
s_mm = 30.0
serial = 0xC0FFEE
[patch.set]
"Touch Pa" = 1500
"Tactel gain" = [1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1.5]
[[patch]]
node_id = 2
link = "plate"
s_mm = 90.0
"""


def test_arm_file_sets_objects_of_one_patch(tmp_path):
    arm = load_arm(put(tmp_path, "arm.toml", ARM))
    assert [p.patch.threshold for p in arm.patches] == [1500.0, 1000.0]
    assert arm.tactel_gain[15] == 1.5
    first, second = ods_of(arm)
    touch = [profile.look_up(od, profile.TOUCH_PA) for od in (first, second)]
    assert [v.value for v in touch] == [1500, None]
    assert first[cia.IDENTITY][cia.IDENTITY_SERIAL].default == 0xC0FFEE
    assert second[cia.IDENTITY][cia.IDENTITY_SERIAL].default == 0


def test_wrong_settings_are_faults_of_the_arm_file(tmp_path):
    text = ARM.replace('"Touch Pa" = 1500', '"Tuch Pa" = 1500\n"Release Pa" = [true, "x"]')
    assert faults_of(load_arm, put(tmp_path, "arm.toml", text)) == [
        "patch[1].set.\"Tuch Pa\": wanted a name in the file such as 'Touch Pa', "
        "or an index such as 0x2030:01",
        "patch[1].set.\"Release Pa\": is (True, 'x'); wanted one value",
    ]


def test_release_above_touch_is_refused():
    with pytest.raises(EdsError, match=r"Thresholds/Release Pa: is 2000.0; wanted at most 1000"):
        describe_patch(load(**{"Release Pa": 2000}))


def test_dcf_for_another_node_is_refused(tmp_path):
    path = put(
        tmp_path, "five.dcf", find_eds("skin-patch").read_text() + "\n[DeviceComissioning]\nNodeID=5\n"
    )
    assert load_eds(path, 5)
    with pytest.raises(EdsError, match=r"NodeID: is 5; wanted 6, the node it is for"):
        load_eds(path, 6)
