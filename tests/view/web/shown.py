"""A page, drawn from a thread, and a source that has one cycle."""

import threading

from skinbus.view.web.follower import History
from skinbus.view.web.page import Page


class Shown:
    """A page, drawn from a thread until it is closed."""

    def __init__(self, source, arm, title="test"):
        self.arm = arm
        self.source = source
        self.page = Page(arm, source, title, port=0)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self.page.run, args=(None, self._over.is_set))
        self._thread.start()

    @property
    def url(self):
        return self.page.server.link

    def close(self):
        self._over.set()
        self._thread.join()
        self.page.close()
        self.source.close()


class Fixed:
    """A source whose cycle stays as it is, until it is another's turn."""

    silent_s, pace, error, has_ended, has_zeros = 0.0, 1.0, None, False, True
    gone, n_lost = "no cycles: bus or master is gone", 0

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
