"""Only own pages connect; those with the token may change something; none can end the server."""

import threading
import time
from contextlib import ExitStack
from types import SimpleNamespace

import pytest
import viser
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from skinbus.view.web.page import CLIENTS, is_own
from tests.cli.patience import PATIENCE_S
from tests.view.web.cycles import ARM, made_cycle
from tests.view.web.shown import Fixed, Shown

PROTOCOL = f"viser-v{viser.__version__}"


@pytest.fixture(scope="module")
def shown():
    shown = Shown(Fixed(made_cycle(1)), ARM)
    yield shown
    shown.close()


def opened(shown, path="", **settings):
    url = f"ws://127.0.0.1:{shown.page.server.get_port()}/{path}"
    times = {"open_timeout": PATIENCE_S, "close_timeout": 0.05}
    return connect(url, subprotocols=[PROTOCOL], **times, **settings)


def closed_with(link):
    with pytest.raises(ConnectionClosed) as closed:
        list(link)  # until it is closed; a normal end raises nothing
    return closed.value.rcvd.code


@pytest.mark.parametrize(
    ("origin", "host", "served_at", "is_ours"),
    [
        ("http://127.0.0.1:8080", "127.0.0.1:8080", "127.0.0.1", True),
        ("http://localhost:8080", "localhost:8080", "127.0.0.1", True),
        ("http://192.168.1.7:8080", "192.168.1.7:8080", "0.0.0.0", True),
        ("https://elsewhere.example", "127.0.0.1:8080", "127.0.0.1", False),
        ("http://elsewhere.example:8080", "elsewhere.example:8080", "127.0.0.1", False),
        ("http://127.0.0.1:9999", "127.0.0.1:8080", "127.0.0.1", False),
        ("http://[", "[", "127.0.0.1", False),
    ],
)
def test_page_of_another_site_is_not_served(origin, host, served_at, is_ours):
    assert is_own(origin, host, served_at) is is_ours


def test_connection_of_another_site_or_with_two_hosts_is_closed(shown):
    with opened(shown, origin="http://elsewhere.example") as link:
        assert closed_with(link) == 1008
    twice = [("Host", "elsewhere.example")]
    with opened(
        shown, origin=f"http://127.0.0.1:{shown.page.server.get_port()}", additional_headers=twice
    ) as link:
        assert closed_with(link) == 1008


def test_only_pages_of_the_link_with_the_token_may_change_something(shown):
    server = shown.page.server
    assert shown.url.endswith(f"ws://127.0.0.1:{shown.page.server.get_port()}/{server.token}")
    for path, may_change in (("", False), ("wrong", False), (server.token, True)):
        with opened(shown, path) as link:
            link.recv(PATIENCE_S)
            newest = max(server._websock_server._live_connections)
            assert server.may_change(SimpleNamespace(client_id=newest)) is may_change
    assert server.request_share_url() is None


@pytest.mark.slow
def test_clients_that_do_not_read_end_nothing_and_too_many_are_refused(shown):
    with ExitStack() as stack:
        links = [stack.enter_context(opened(shown)) for _ in range(CLIENTS)]
        drawn, end = shown.page.n_drawn, time.monotonic() + PATIENCE_S
        for number in range(2, 40):
            shown.source.newest = made_cycle(number, [{"s": 0.05, "force": 4.0}])
            while shown.page.drawing.number < number:
                assert time.monotonic() < end
                threading.Event().wait(0.005)
        assert shown.page.n_drawn > drawn
        with opened(shown) as one_more:
            assert closed_with(one_more) == 1013
        assert links[0].recv(PATIENCE_S)
