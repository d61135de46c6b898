"""A page served from a thread, and a follower that has one cycle."""

import threading

from skinbus.view.web.history import History
from skinbus.view.web.page import Page, Settings


class Shown:
    """A page, served from a thread until it is closed."""

    def __init__(self, follower, arm, title="test", *, dark=False, recorder=None):
        self.arm = arm
        self.follower = follower
        self.page = Page(arm, follower, title, Settings(port=0, dark=dark), recorder)
        self._thread = threading.Thread(target=self.page.run)
        self._thread.start()

    @property
    def url(self):
        return f"http://127.0.0.1:{self.page.port}/"

    def close(self):
        self.page.stop()
        self._thread.join()
        self.page.close()
        self.follower.close()


class Fixed:
    """A follower whose cycle stays as it is, until it is another's turn."""

    silent_s, error, has_ended = 0.0, None, False

    def __init__(self, *cycles):
        self.history, self.newest = History(), cycles[-1]
        self.n_cycles, self.zeroed = len(cycles), []
        for cycle in cycles:
            self.history.take(cycle)

    def zero(self, patch):
        """Note it."""
        self.zeroed.append(patch)

    def close(self):
        """Do nothing."""
