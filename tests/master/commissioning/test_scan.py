"""Scanning a bus: every node is found once, with what it says of itself, and nothing is changed."""

from skinbus.config.system import load_arm
from skinbus.master import Master
from skinbus.master.commissioning.scan import Candidate, Found, Match, Scanner, match
from skinbus.master.patches.provisioning import Identity
from skinbus.objects import cia
from tests.master.commission import Bench, patch

STATES = cia.NmtState


def test_every_node_is_found_with_identity_and_state():
    devices = [patch(1, serial=11), patch(64, "skin-patch-8bit", serial=12), patch(127, "skin-patch-8x8")]
    bench = Bench(*devices)
    devices[1].command(cia.NmtCommand.START)
    scanner = Scanner()
    bench.run(scanner)
    assert sorted(scanner.nodes) == [1, 64, 127]
    for device in devices:
        node = scanner.nodes[device.node_id]
        said = [device.get(cia.DEVICE_TYPE), *(device.get(cia.IDENTITY, sub) for sub in (1, 2, 3, 4))]
        assert list(node.numbers.values()) == said
        assert node.state is device.nmt_state
        assert node.answers
        assert node.name == device.get(cia.DEVICE_NAME)
        assert node.error_register == 0


def test_stopped_node_is_found_by_its_heartbeat():
    device = patch(5)
    bench = Bench(device)
    device.command(cia.NmtCommand.STOP)
    scanner = Scanner()
    bench.run(scanner)
    assert scanner.nodes[5] == Found(5, state=STATES.STOPPED)


def test_node_without_heartbeat_is_found_by_its_answers():
    device = patch(5)
    bench = Bench(device)
    device.set(cia.HEARTBEAT_PRODUCER, 0, 0)
    bench.pass_ms(600)
    scanner = Scanner()
    bench.run(scanner)
    assert scanner.nodes[5].answers
    assert scanner.nodes[5].state is None


def test_nodes_without_node_id_and_a_master_are_noticed():
    for cores, unconfigured, sync in [
        ((patch(255),), True, False),
        ((patch(3), Master(load_arm("pad"))), False, True),
    ]:
        scanner = Scanner()
        Bench(*cores).run(scanner)
        assert (scanner.has_unconfigured, scanner.other_master.is_present) == (unconfigured, sync)


def test_scan_reads_only():
    device = patch(5)
    bench = Bench(device)
    bench.run(Scanner())
    mine = [f for f in bench.frames if f.can_id in (0, cia.SDO_CLIENT_BASE + 5)]
    assert {f.data[0] >> 5 for f in mine} <= {2, 3}  # uploads and their segments
    assert device.dropped == 0


WANTED = Identity(device_type=0x40191, vendor=1, product=2, revision=0x10000)


def node(**numbers):
    return Found(
        1, numbers={"device_type": 0x40191, "vendor": 1, "product": 2, "revision": 0x10000} | numbers
    )


def test_match_asks_for_type_vendor_and_product_and_prefers_revision_and_serial():
    plain = Candidate("plain", WANTED)
    older = Candidate("older", Identity(device_type=0x40191, vendor=1, product=2, revision=0x20000))
    mine = Candidate("mine", Identity(device_type=0x40191, vendor=1, product=2, revision=0x10000, serial=7))
    other = Candidate("other", Identity(device_type=0x40191, vendor=1, product=3))
    everything = [plain, older, mine, other]
    assert match(node(serial=1), everything) == Match(("plain",), True)
    assert match(node(serial=7), everything) == Match(("mine",), True)
    assert match(node(serial=1), [older, other]) == Match(("older",), False)
    assert match(node(serial=1), [other]) == Match((), False)
    assert match(node(vendor=5), everything) == Match((), False)
    assert match(Found(1), everything) == Match((), False)
