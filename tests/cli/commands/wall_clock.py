"""The clock of recordings that tests make: it begins at a time of day."""

from skinbus.can.clock import VirtualClock

EPOCH_NS = 1_795_263_452_171_891_000


class WallClock(VirtualClock):
    def wall_ns(self, t_ns):
        return EPOCH_NS + t_ns
