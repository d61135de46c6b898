"""`skinbus patch`: a sensor that Python can read as a patch on a CAN bus."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from typing import Any

import click

from skinbus.bus.monotonic_clock import MonotonicClock
from skinbus.can.fd import CLASSIC_BYTES
from skinbus.cli.host import Host
from skinbus.cli.options import Range, Where, bus_options, function_named, seconds_option
from skinbus.cli.output import echo
from skinbus.formatting import counted
from skinbus.gateway.reader import Reader
from skinbus.node import Device, PatchHost
from skinbus.objects.board import describe_patch
from skinbus.objects.eds import load_eds
from skinbus.objects.pdo import frame_bytes
from skinbus.objects.profile import GUARD_PERIOD_US, has, index_of


@click.command()
@click.argument("eds")
@click.option(
    "--reader",
    "read",
    required=True,
    callback=lambda ctx, parameter, value: function_named(value),
    help="MODULE:FUNCTION that reads the sensor; the module may be in this folder.",
)
@click.option("--node", "node_id", required=True, type=click.IntRange(1, 126), help="Node-ID of the patch.")
@click.option(
    "--rate-hz",
    default=100.0,
    type=Range(min=1.0, max=1000.0),
    help="How often the function is called at most.",
)
@bus_options
@seconds_option
def command(
    eds: str, read: Callable[[], Any], node_id: int, rate_hz: float, where: Where, seconds: float | None
) -> None:
    """Make a sensor a patch on a CAN bus, until Ctrl-C.

    EDS describes the board, as `skinbus board new` writes it. The function returns one count for each tactel,
    left-adjusted: 32767 is full scale of 16 bits. A tactel that has no reading is NaN. The function has a
    thread of its own and may wait for the sensor. While it raises, hangs for 0.1 s, or returns anything else,
    the patch reports an error (EMCY 0x5000) and sends no readings. Status 1: it was so at the end.

    \b
    Examples:
      skinbus board new --grid 4x4 --pitch-mm 10 --bits 16 --out pad.eds
      skinbus patch pad.eds --reader made_up_pad:read --node 5 --channel can0
    """
    od = load_eds(eds, node_id)
    patch = describe_patch(od, eds)
    reader = Reader(read, patch.n_tactels, patch.transducer.bits, _say)
    device = Device(od, node_id, storage={})
    if has(od, GUARD_PERIOD_US):
        device.set(*index_of(od, GUARD_PERIOD_US), round(1e6 / rate_hz))
    place = where.places()[0]
    if frame_bytes(od) > CLASSIC_BYTES:
        place = place._replace(data_bitrate=place.bitrate)
    clock, stop = MonotonicClock(), threading.Event()
    host = Host(PatchHost([device], reader.newest), [place], steady=True)
    echo(f"{eds}: node {node_id} of {counted(patch.n_tactels, 'tactel')} on {place}; Ctrl-C stops")
    # not waited for at the end: it may hang
    threading.Thread(target=reader.run, args=(clock, 1.0 / rate_hz, stop), name="reader", daemon=True).start()
    with host:
        host.wait(seconds)
        is_well = reader.newest(clock.now_ns()).healthy.any()
    stop.set()
    if not is_well:
        echo(
            f"no readings at the end: the reader {reader.fault or 'hangs, or has NaN for all tactels'}",
            err=True,
        )
        sys.exit(1)


def _say(fault: str) -> None:
    echo(f"the reader {fault}" if fault else "the reader is well again", err=True)
