"""Events: what a core or a bus detected and its host reports; every kind there is."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class EventKind(StrEnum):
    """Kinds of events; where a state ends, there is a kind for its end too."""

    STOP = "stop"
    """A core asks its host to end."""

    BUS_LOST = "bus-lost"
    BUS_BACK = "bus-back"
    BUS_OFF = "bus-off"
    BUS_OFF_END = "bus-off-end"
    ERROR_PASSIVE = "error-passive"
    ERROR_PASSIVE_END = "error-passive-end"
    ERROR_WARNING = "error-warning"
    ERROR_WARNING_END = "error-warning-end"
    FRAMES_DROPPED = "frames-dropped"
    """Received frames that the machine had no room for; ``count`` of them."""
    CONTROLLER_OVERFLOW = "controller-overflow"
    SEND_QUEUE_FULL = "send-queue-full"
    SEND_QUEUE_FULL_END = "send-queue-full-end"
    BABBLING = "babbling"
    """A node sends ``count`` frames a second under ``cob_id``, more than half of all."""
    BABBLING_END = "babbling-end"

    DROPPED = "dropped"
    """A node received a frame that breaks a rule, and ignored it."""
    NMT_STATE = "nmt-state"
    """A node changed its NMT state."""
    STORAGE = "storage"
    """Parameters could not be stored or loaded."""
    BIT_RATE = "bit-rate"
    """LSS changes the bit rate."""
    HEARTBEAT_LOST = "heartbeat-lost"
    HEARTBEAT_BACK = "heartbeat-back"
    GUARDING_LOST = "guarding-lost"
    """The master that guarded a node has stopped."""

    PATCH_STARTED = "patch-started"
    """It was checked, configured and started."""
    PATCH_REFUSED = "patch-refused"
    """It is not what the arm file asks for, or does not take its configuration."""
    PATCH_DOUBLED = "patch-doubled"
    """Two boards have its node-ID."""
    PATCH_LOST = "patch-lost"
    """It stopped answering while it booted, or has never answered."""
    READINGS_LOST = "readings-lost"
    PATCH_BACK = "patch-back"
    """It was lost, and its readings are back or it is started again."""
    PATCH_FELL_BACK = "patch-fell-back"
    """Its heartbeat reports that it is no longer operational, and no command of ours caused that."""
    PATCH_REBOOTED = "patch-rebooted"
    """Its boot-up message came while it was operational: it was reset, or its supply failed."""
    PATCH_REPLACED = "patch-replaced"
    """Another board, by its serial number, has the place of one that ran before."""
    PATCH_CONFIGURED = "patch-configured"
    """Objects were downloaded to it."""
    PATCH_EMCY = "patch-emcy"
    PATCH_EMCY_CLEARED = "patch-emcy-cleared"

    TACTELS_IMPLAUSIBLE = "tactels-implausible"
    """Other tactels of a patch than before are not plausible: ``count`` of them, ``detail`` names them."""
    TACTELS_IMPLAUSIBLE_END = "tactels-implausible-end"
    READINGS_REPEATED = "readings-repeated"
    """A patch answers SYNCs with readings that it has sent before."""
    READINGS_REPEATED_END = "readings-repeated-end"
    GUARDING = "guarding"
    """A guard has begun: every guarded patch is armed."""
    GUARD_STOP = "guard-stop"
    """A guard stops the robot; ``detail`` says why."""
    GUARD_WAITS = "guard-waits"
    """A guard has not yet begun; ``detail`` says what it waits for."""
    GUARD_TRIPPED = "guard-tripped"
    """A patch says by which of its tactels its guard has tripped."""
    CONFIRMED = "confirmed"
    """A node has taken the value that stops it, or that takes a trip back."""
    NOT_CONFIRMED = "not-confirmed"
    """It has not; it is sent again."""
    CONTACTS_LOST = "contacts-lost"
    """The shared memory with contacts is stale or gone."""
    CONTACTS_BACK = "contacts-back"
    NOT_GUARDING = "not-guarding"
    """Patches that the arm file has limits for do not run, hold other limits, or have tactels that are not
    plausible: ``count`` of them, ``detail`` names them."""
    NOT_GUARDING_END = "not-guarding-end"
    ZEROED = "zeroed"
    LEVEL = "level"
    """The level of the estimator changed."""
    OTHER_MASTER = "other-master"
    OTHER_MASTER_END = "other-master-end"

    @property
    def end(self) -> EventKind:
        """The kind of this state's end; ValueError if it has none."""
        return EventKind(f"{self.value}-end")


@dataclass(frozen=True, slots=True)
class Event:
    """One occurrence: a change of state, a dropped frame, a fault."""

    t_ns: int
    kind: EventKind
    node_id: int = 0
    detail: str = ""
    count: int = 0
    """How many, where things are counted."""
    cob_id: int = 0
    """Identifier of the frames that it is about."""
    bus: int = 0
    """Number of the bus, where the core is on several."""
