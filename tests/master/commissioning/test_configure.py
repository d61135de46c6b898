"""Configuring patches: what is asked for is there, was read back and outlives a power cycle."""

import re
import struct

import pytest

from skinbus.can.event import EventKind
from skinbus.master.patches.provisioning import Change, Configurer, Provision, expected_node
from skinbus.node import Device
from skinbus.objects import cia
from skinbus.objects.eds import load_eds
from skinbus.objects.settings import freeze
from tests.bus.cores import Repeater
from tests.master.commission import Bench, patch
from tests.master.misbehaving import Stubborn
from tests.master.misbehaving_rig import OTHER_SYNC

TOUCH, RELEASE = (0x2030, 1), (0x2030, 2)
THRESHOLD = freeze({"Touch Pa": 1500})
GAINS = tuple(1.0 + 0.01 * k for k in range(16))
MUCH = freeze({"Touch Pa": 1500, "Tactel gain": GAINS, "0x1800:05": 250, "Healthy tactels": 0xFFFE})


def plans(node_ids, settings=THRESHOLD, **identity):
    return [expected_node(n, load_eds("skin-patch", n, settings=settings, **identity)) for n in node_ids]


def configured(device, *args, **settings):
    """Let a patch be configured; return what came of it."""
    core = Configurer(*args, **settings)
    Bench(device).run(core)
    return core.results[3]


def test_factory_patch_gets_every_value_and_keeps_it_over_a_power_cycle():
    storage = {}
    device = patch(3, storage=storage)
    factory = device.get(*TOUCH)
    result = configured(device, plans([3], MUCH))
    assert result.outcome is Provision.CHANGED
    assert Change(*TOUCH, struct.pack("<I", factory), struct.pack("<I", 1500)) in result.changes
    reborn = patch(3, storage=storage)
    Bench(reborn)
    for held in (device, reborn):
        assert held.get(*TOUCH) == 1500
        assert [held.get(0x2011, k) for k in (1, 16)] == pytest.approx([GAINS[0], GAINS[15]])
        assert held.get(0x1800, 5) == 250
        assert held.get(0x2040) == 0xFFFE


def test_second_run_changes_nothing_and_writes_nothing():
    bench = Bench(patch(3))
    bench.run(Configurer(plans([3], MUCH)))
    n_before = len(bench.frames)
    core = Configurer(plans([3], MUCH))
    bench.run(core)
    assert core.results[3].outcome is Provision.SAME
    assert core.results[3].changes == ()
    requests = [f.data[0] >> 5 for f in bench.frames[n_before:] if f.can_id == cia.SDO_CLIENT_BASE + 3]
    assert 1 not in requests  # 1 is "initiate download"


def test_dry_run_says_what_would_change_and_sends_no_download_and_no_command():
    device = patch(3)
    bench = Bench(device)
    before = device.get(*TOUCH)
    core = Configurer(plans([3]), dry_run=True)
    bench.run(core)
    assert core.results[3].outcome is Provision.WOULD_CHANGE
    assert [change[:2] for change in core.results[3].changes] == [TOUCH]
    assert device.get(*TOUCH) == before
    assert not [f for f in bench.frames if f.can_id == cia.NMT_COMMAND_ID]


def test_other_device_is_refused_and_left_as_it_is():
    device = patch(3)
    before = device.get(*TOUCH)
    result = configured(device, plans([3], serial=77))
    assert result.outcome is Provision.REFUSED
    assert "serial number" in result.reason
    assert device.get(*TOUCH) == before


def test_refused_value_is_named():
    device = patch(3)
    device.on_write = lambda index, sub, value: cia.AbortCode.VALUE_HIGH if (index, sub) == TOUCH else None
    result = configured(device, plans([3]))
    assert result.outcome is Provision.REFUSED
    assert re.search("0x2030:01.*too high", result.reason)


def test_patch_that_cannot_store_says_so():
    device = Device(load_eds("skin-patch", 3), 3)
    for _ in range(2):  # also when it holds everything
        assert configured(device, plans([3])).outcome is Provision.NOT_STORED
    assert device.get(*TOUCH) == 1500


def test_value_that_did_not_stay_is_found_by_reading_back():
    result = configured(Stubborn(patch(3), *TOUCH, 999), plans([3]))
    assert result.outcome is Provision.REFUSED
    assert "0x2030:01" in result.reason


@pytest.mark.parametrize("settings", [THRESHOLD, freeze({})], ids=["some", "none"])
def test_what_the_arm_file_no_longer_names_goes_back_to_its_default(settings):
    device = patch(3)
    default = device.get(*RELEASE)
    bench = Bench(device)
    bench.run(Configurer(plans([3], freeze({"Release Pa": 321}))))
    assert device.get(*RELEASE) == 321
    core = Configurer(plans([3], settings))
    bench.run(core)
    assert core.results[3].is_restored
    assert core.results[3].outcome.is_good
    assert device.get(*RELEASE) == default


def test_nothing_is_sent_while_a_master_is_at_work():
    bench = Bench(patch(3), Repeater(OTHER_SYNC, 20_000_000))
    core = Configurer(plans([3]))
    events = bench.run(core)
    assert [event.kind for event in events][:1] == [EventKind.OTHER_MASTER]
    assert not core.results
    assert not [f for f in bench.frames if f.can_id in (cia.NMT_COMMAND_ID, cia.SDO_CLIENT_BASE + 3)]
