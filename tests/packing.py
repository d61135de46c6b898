"""Counts of an arm as the frames that carry them: what all patches send in one cycle."""

from types import SimpleNamespace

import numpy as np

from skinbus.can.fd import CLASSIC_BYTES
from skinbus.can.frame import LONG, Frame
from skinbus.objects.contacts import FORCE_STEP, LENGTH_STEP, PAYLOAD


def pack(plan, counts, batch, t_ns=0, stamps=None):
    """Append to a batch the frames of a ``ReadingsPlan``, patch after patch; return how many.

    Counts fit their entries. ``stamps`` are as of ``ReadingsPlan.unpack``.
    """
    cob_ids = {int(plan._pdo_of[key]): key for key in zip(*np.nonzero(plan._pdo_of >= 0), strict=True)}
    for pdo in range(plan.n_frames):
        bus, cob_id = cob_ids[pdo]
        n, number = int(plan._length[pdo]), 0
        for entry, tactel in enumerate(plan._tactel[pdo]):
            word = int(counts[tactel]) & int(plan._span[pdo, entry]) - 1
            number |= word << int(8 * plan._first[pdo, entry] + plan._shift[pdo, entry])
        data = bytearray(number.to_bytes(n, "little"))
        if stamps is not None:
            for column in np.flatnonzero(plan.stamped[pdo]):
                data[plan._stamp[pdo, column]] = stamps[pdo, column]
        flags = LONG if n > CLASSIC_BYTES else 0
        batch.extend([Frame(int(cob_id), bytes(data), t_ns, flags, int(bus))])
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
