"""What somebody hears who listens to a rig."""

from skinbus.skin.cycle import SkinLayout
from skinbus.skin.feed import Feed
from skinbus.skin.listened import ListenCore


def listen(rig):
    """A listener on the wire of a rig that makes pressures, and the feed of what it has heard."""
    arm = rig.scene.arm
    feed = Feed(SkinLayout.of(arm), "a test")
    feed.now_ns = rig.wire.clock.now_ns
    core = ListenCore(arm, 127, feed, readings=True)
    rig.wire.attach(core)
    return core, feed
