"""The ``canopen`` package as client of our devices and as server of our SDO client."""

from functools import partial

import can
import canopen
import pytest
from canopen.objectdictionary import ODVariable
from canopen.sdo.exceptions import SdoAbortedError

from skinbus.can.frame import Frame
from skinbus.node import Device, SdoClient
from skinbus.node.lss import UNCONFIGURED
from skinbus.node.sdo_server import PACE_NS
from skinbus.objects.eds import load_eds
from tests.node.node_table import DEVICES


class DeviceBus(can.BusABC):
    """A bus without threads: what is sent is stepped into a device, whose answers come straight back."""

    channel_info = "one device"

    def __init__(self, device):
        self.device = device
        self.network = None
        self.now_ns = 0
        self.heard = []

    def send(self, msg, timeout=None):
        self.now_ns += 100_000
        wake_ns = self.step([Frame(msg.arbitration_id, bytes(msg.data), self.now_ns)])
        while wake_ns <= self.now_ns + PACE_NS:  # it sends on
            self.now_ns = wake_ns
            wake_ns = self.step()

    def step(self, frames=()):
        step = self.device.step(self.now_ns, frames)
        for frame in step.frames:
            self.heard.append(frame)
            self.network.notify(frame.can_id, bytearray(frame.data), self.now_ns / 1e9)
        return step.wake_ns

    def shutdown(self):
        self._is_shutdown = True


def connect(which, node_id=None, storage=None):
    eds, default_id = DEVICES[which]
    device = Device(load_eds(eds, default_id), node_id or default_id, storage=storage)
    bus = DeviceBus(device)
    network = canopen.Network(bus)
    bus.network = network
    network.listeners[:] = []
    node = network.add_node(canopen.RemoteNode(default_id, load_eds(eds, default_id)))
    node.nmt.add_heartbeat_callback(lambda state: None)
    bus.step()
    return device, bus, network, node


@pytest.fixture(params=["patch", "master"])
def any_device(request):
    return connect(request.param)


def test_client_reads_every_object_as_the_device_has_it(any_device):
    device, _, _, node = any_device
    n = 0
    for index, item in device.layout.od.items():
        variables = [item] if isinstance(item, ODVariable) else item.values()
        for variable in variables:
            if index < 0x1000 or not variable.readable:
                continue
            value = device.get(index, variable.subindex)
            if value is None or (index == 0x1003 and variable.subindex):
                with pytest.raises(SdoAbortedError) as caught:
                    node.sdo.upload(index, variable.subindex)
                assert caught.value.code == 0x08000024
                continue
            seen = variable.decode_raw(node.sdo.upload(index, variable.subindex))
            if index not in (0x1010, 0x1011, 0x2060):  # what they can do, a checksum of what is there
                assert seen == value, hex(index)
            n += 1
    assert n > 100


def test_client_writes_and_reads_back_every_writable_number(any_device):
    device, _, _, node = any_device
    n = 0
    for entry in device.layout.entries.values():
        if (
            entry.index < 0x2000
            or not (entry.writable and entry.readable and entry.size)
            or entry.variable.min is not None
        ):
            continue
        data = bytes(entry.size)
        node.sdo.download(entry.index, entry.sub, data)
        assert node.sdo.upload(entry.index, entry.sub) == data
        n += 1
    assert n > 20 or device.node_id == 127


@pytest.mark.parametrize("crc", [True, False])
@pytest.mark.parametrize("size", [1, 6, 7, 8, 888, 889, 890, 2000])  # a block has 889 bytes
def test_client_writes_and_reads_in_blocks(size, crc):
    device, _, _, node = connect("master")
    data = bytes((11 * i + size) % 256 for i in range(size))
    with node.sdo.open(0x1F22, 5, "wb", size=size, block_transfer=True, request_crc_support=crc) as file:
        file.write(data)
    assert device.get(0x1F22, 5) == data
    with node.sdo.open(0x1F22, 5, "rb", block_transfer=True) as file:
        assert file.read() == data
    assert node.sdo.upload(0x1F22, 5) == data


def test_remote_node_consumes_our_pdos():
    device, bus, network, node = connect("patch")
    node.tpdo.read()
    assert node.tpdo[4].cob_id == 0x485
    assert node.tpdo[1].trans_type == 1
    device.image_view(0x6401, 1, 16)[:] = range(-8, 8)
    node.nmt.state = "OPERATIONAL"
    network.sync.transmit(1)
    values = [variable.raw for k in (1, 2, 3, 4) for variable in node.tpdo[k].map]
    assert values == list(range(-8, 8))
    assert len(bus.heard) >= 4


def test_boot_up_heartbeat_and_emcy_are_understood(any_device):
    device, bus, _, node = any_device
    assert node.nmt.state == "PRE-OPERATIONAL"
    node.sdo[0x1017].raw = 20
    node.nmt.send_command(2)
    bus.now_ns += 20_000_000
    bus.step()
    assert node.nmt.state == "STOPPED"
    node.nmt.send_command(0x81)
    assert node.nmt.state == "PRE-OPERATIONAL"
    device.emcy(0x8110, data=b"\x01")
    bus.step()
    assert (node.emcy.log[-1].code, node.emcy.log[-1].register) == (0x8110, 0x11)
    assert node.sdo[0x1003][1].raw == 0x00018110


def test_lss_master_finds_and_names_our_node(monkeypatch):
    monkeypatch.setattr("canopen.lss.time.sleep", lambda s: None)
    device, bus, network, _ = connect("patch", node_id=UNCONFIGURED, storage={})
    device.set(0x1018, 4, 0x12345678)
    network.subscribe(network.lss.LSS_RX_COBID, network.lss.on_message_received)
    network.lss.RESPONSE_TIMEOUT = 1e-4  # what is not answered at once never is
    found, identity = network.lss.fast_scan()
    assert found
    assert identity == [device.get(0x1018, k) for k in (1, 2, 3, 4)]
    network.lss.configure_node_id(9)
    network.lss.configure_bit_timing(2)
    network.lss.store_configuration()
    assert network.lss.inquire_lss_address(0x5D) == 0x12345678
    network.lss.send_switch_state_global(0)
    assert device.node_id == 9
    assert bus.heard[-1][:2] == (0x709, b"\0")


class ServerBus(can.BusABC):
    """Collects what a canopen LocalNode sends."""

    channel_info = "local node"

    def __init__(self):
        self.sent = []

    def send(self, msg, timeout=None):
        self.sent.append(Frame(msg.arbitration_id, bytes(msg.data)))

    def shutdown(self):
        self._is_shutdown = True


def local_node(eds):
    """A canopen LocalNode and a client of ours: a function that ends the client's transfer."""
    bus, client = ServerBus(), SdoClient(9)
    network = canopen.Network(bus)
    network.add_node(canopen.LocalNode(9, load_eds(eds, 9)))
    return client, partial(transfer, client, network, bus)


def transfer(client, network, bus):
    for now_ns in range(1000):
        answers, bus.sent = bus.sent, []
        for frame in client.step(now_ns, answers):
            network.notify(frame.can_id, bytearray(frame.data), 0.0)
        if not client.busy:
            return client.result
    raise AssertionError("the transfer does not end")


@pytest.mark.parametrize("size", [1, 2, 4, 5, 7, 8, 14, 15, 1000])
def test_our_client_writes_to_and_reads_from_a_canopen_server(size):
    client, end = local_node("skin-master")
    data = bytes((7 * i + size) % 256 for i in range(size))
    client.start_write(0x1F22, 3, data)
    assert end().abort is None
    client.start_read(0x1F22, 3)
    assert end().unwrap() == data


def test_our_client_understands_the_aborts_of_a_canopen_server():
    client, end = local_node("skin-patch")
    client.start_read(0x5FFF, 0)
    assert end().abort == 0x06020000
