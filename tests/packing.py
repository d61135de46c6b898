"""Counts of an arm as the frames that carry them: what all patches send in one cycle."""

from types import SimpleNamespace

import numpy as np

from skinbus.can.fd import CLASSIC_BYTES
from skinbus.can.frame import LONG, MAX_DATA
from skinbus.objects.contacts import FORCE_STEP, LENGTH_STEP, PAYLOAD


def pack(plan, counts, batch, t_ns=0, stamps=None):
    """Append to a batch the frames of a ``ReadingsPlan``, patch after patch; return how many.

    Counts beyond the width of their entry are clipped. ``stamps`` are as of ``ReadingsPlan.unpack``.
    """
    first, last = batch.n, batch.n + plan.n_frames
    frames = batch.frames[first:last]
    bus, cob_id = np.nonzero(plan._pdo_of >= 0)
    order = np.argsort(plan._pdo_of[bus, cob_id])
    frames["bus"], frames["can_id"], frames["length"] = bus[order], cob_id[order], plan._length
    frames["flags"] = np.where(plan._length > CLASSIC_BYTES, LONG, 0)
    words = np.clip(counts[plan._tactel], plan._above - plan._span, plan._above - 1)
    words = (words & plan._span - 1) << plan._shift
    for pdo in range(plan.n_frames):
        number = 0
        for word, byte in zip(words[pdo].tolist(), plan._first[pdo].tolist(), strict=True):
            number |= word << 8 * byte
        frames["data"][pdo] = np.frombuffer(number.to_bytes(MAX_DATA, "little"), np.uint8)
    if stamps is not None:
        pdos, columns = np.nonzero(plan.stamped)
        frames["data"][pdos, plan._stamp[pdos, columns]] = stamps[pdos, columns]
    batch.t_ns[first:last] = t_ns
    batch.n = last
    return plan.n_frames


def unpack_contacts(payloads):
    """Return the contacts in payloads of 8 bytes each, as columns in SI units."""
    records = np.frombuffer(bytes(payloads), PAYLOAD)
    return SimpleNamespace(
        id=records["id"],
        link=records["link_state"] & 0xF,
        state=records["link_state"] >> 4,
        s=records["s"] * LENGTH_STEP,
        a=records["a"] * LENGTH_STEP,
        force=records["force"] * FORCE_STEP,
    )
