"""For every test: hypothesis makes the same examples, however slow the machine; signals are heard."""

import gc
import signal

import pytest
from hypothesis import HealthCheck, settings

from tests.missed import MISSED

settings.register_profile(
    "all",
    max_examples=40,
    deadline=None,
    derandomize=True,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow],  # as fast as the machine lets it be
)
settings.register_profile("quick", settings.get_profile("all"), max_examples=10)
settings.load_profile("quick")  # --hypothesis-profile=all, as tools/test --all gives it, is the other


def pytest_collection_modifyitems(items):
    """Slow tests begin first: none is still running alone when the other processes have ended."""
    items.sort(key=lambda item: item.get_closest_marker("slow") is None)
    for item in items:
        if reason := MISSED.get(item.nodeid):
            item.add_marker(pytest.mark.xfail(reason=reason, strict=False))


@pytest.hookimpl(trylast=True)
def pytest_collection_finish():
    """Garbage is looked for less often, and not among the half million objects of modules."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000)  # Python's 700 took a fourth of the time of tests with a master


@pytest.fixture(scope="session", autouse=True)
def _signals_are_heard():
    """A shell starts what runs in the background with SIGINT ignored, and children inherit that."""
    usual = {
        signal.SIGINT: signal.default_int_handler,
        signal.SIGTERM: signal.SIG_DFL,
        signal.SIGHUP: signal.SIG_DFL,
    }
    for number, handler in usual.items():
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, handler)
