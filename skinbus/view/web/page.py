"""The web page: a viser server on this machine that shows what a source has, at the pace of the eye.

All that it draws and all that its buttons ask for runs on the one event loop of the server. It only shows;
the buttons that change something are on pages whose link has the token that the command prints.
"""

from __future__ import annotations

import asyncio
import secrets
import socket
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from io import StringIO
from ipaddress import ip_address
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import viser
import viser.uplot
from viser._messages import RunJavascriptMessage
from viser.infra import WebsockClientConnection

from skinbus.errors import SkinbusError
from skinbus.model import Arm
from skinbus.skin.pressed import PressedLoads
from skinbus.view.web import colours, panels
from skinbus.view.web.drawing import Drawer, Drawing
from skinbus.view.web.follower import Follower
from skinbus.view.web.poses import Poses
from skinbus.view.web.scene import SceneNodes

DRAW_S = 0.05
"""Between two pictures: twenty a second."""
PANEL_S = 0.5
"""Between two updates of the panels: what can be read."""
SERIES = ("#e8590c", "#1971c2", "#2f9e44", "#9c36b5", "#e03131", "#0c8599")
"""Of the contacts in the plot of forces: colours that can be distinguished."""
CLIENTS = 16
"""Pages that are served at a time: one that does not read costs memory for what waits for it."""
REFUSED = 1008
"""WebSocket close code for a violated policy (RFC 6455, 7.4.1)."""
BUSY = 1013
COARSE = """
const settings = window.__viserTestpoints?.devSettings;
const gl = document.createElement("canvas").getContext("webgl2");
const renderer = gl?.getExtension("WEBGL_debug_renderer_info")?.UNMASKED_RENDERER_WEBGL;
const name = renderer ? gl.getParameter(renderer) : "";
gl?.getExtension("WEBGL_lose_context")?.loseContext();
if (/swiftshader|llvmpipe|software/i.test(name) && settings && settings.get().fixedDpr === null)
  settings.set({ fixedDpr: 0.5 });
"""
"""For a page without a graphics card: it draws a quarter of the pixels, unless its address has a fixedDpr."""


class Server(viser.ViserServer):
    """A viser server without share link, closed to pages of other sites."""

    def __init__(self, host: str, port: int) -> None:
        """Serve at an address; what viser prints of itself is left out.

        Raises:
            SkinbusError: this machine does not have the address.
        """
        try:  # viser would wait for ever
            socket.create_server((host, 0), family=socket.getaddrinfo(host, 0)[0][0]).close()
        except (OSError, UnicodeError) as error:
            raise SkinbusError(f"--host {host}: wanted an address of this machine ({error})") from error
        self.token = secrets.token_urlsafe(12)
        self._may_change: set[int] = set()
        with redirect_stdout(StringIO()):
            super().__init__(host=host, port=port, verbose=False)
        self._websock_server.on_client_connect(self._admit)
        self._websock_server.queue_message(RunJavascriptMessage(source=COARSE))

    @property
    def link(self) -> str:
        """The address of the page; it has the token as the path of the page's connection."""
        host = self.get_host()
        here = f"{f'[{host}]' if ':' in host else host}:{self.get_port()}"
        return f"http://{here}/?websocket=ws://{here}/{self.token}"

    def may_change(self, client: viser.ClientHandle) -> bool:
        """Whether a page was opened by the link with the token."""
        return client.client_id in self._may_change

    async def _admit(self, client: WebsockClientConnection) -> None:
        """Close a connection that a page of another site has opened, as browsers allow, or one too many."""
        server = self._websock_server
        connection = server._live_connections[client.client_id]
        request = connection.request
        origins, hosts = (request.headers.get_all(name) if request else [] for name in ("Origin", "Host"))
        if origins and not (
            len(origins) == len(hosts) == 1 and is_own(origins[0], hosts[0], self.get_host())
        ):
            await connection.close(REFUSED, "opened by a page of another site")
        elif len(server._live_connections) > CLIENTS:
            await connection.close(BUSY, f"{CLIENTS} pages are open")
        elif request and secrets.compare_digest(request.path.encode(), f"/{self.token}".encode()):
            self._may_change.add(client.client_id)

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Return nothing: a share link would carry the page, and its buttons, through somebody's server."""
        return None


def is_own(origin: str, host: str, served_at: str) -> bool:
    """Whether the origin of a page is the server that it connects to, under a name that is its own.

    A name that somebody else's name server leads here is not: it would make any site the origin.
    """
    try:
        name = urlsplit(f"//{host}").hostname or ""
        if name not in (served_at, "localhost"):
            ip_address(name)
    except ValueError:
        return False
    return urlsplit(origin).netloc == host


class Page:
    """Shows an arm until it is stopped."""

    def __init__(
        self,
        arm: Arm,
        source: Follower,
        title: str,
        *,
        host: str = "127.0.0.1",
        port: int = 8080,
        dark: bool = False,
    ) -> None:
        """Serve.

        Args:
            arm: that is shown.
            source: has the cycles.
            title: of the source, for people.
            host: address to serve on.
            port: 0 for any.
            dark: whether it begins with dark colours.

        Raises:
            ConfigError: faults of the robot's URDF.
            SkinbusError: this machine does not have the address.
        """
        self._arm, self._source, self._title = arm, source, title
        self._poses = Poses(arm)
        self._drawer = Drawer(arm, self._poses)
        self._pressed = PressedLoads(arm)
        self.server = server = Server(host, port)
        self.scene = SceneNodes(server, arm, self._poses)
        self.n_drawn = 0
        self.drawing: Drawing | None = None
        """What was drawn last."""
        self._ids: list[int] = []
        self._panel_s = 0.0
        self._is_known = not self._poses.note
        server.gui.configure_theme(
            dark_mode=dark, show_logo=False, show_share_button=False, control_width="large"
        )
        self._build(server.gui)
        server.on_client_connect(self._add_zeros)

    def run(self, seconds: float | None = None, is_over: Callable[[], bool] = lambda: False) -> None:
        """Draw until ``is_over``, or for so long."""
        asyncio.run_coroutine_threadsafe(self._run(seconds, is_over), self.server.get_event_loop()).result()

    def close(self) -> None:
        """End the server."""
        with redirect_stdout(StringIO()):
            self.server.stop()

    async def _run(self, seconds: float | None, is_over: Callable[[], bool]) -> None:
        begin = now = time.monotonic()
        while not is_over() and (seconds is None or now - begin < seconds):
            now = time.monotonic()
            self.update()
            await asyncio.sleep(max(DRAW_S - (time.monotonic() - now), 0.0))

    def update(self) -> None:
        """Draw the newest cycle, where it is new, and the panels when it is their time."""
        cycle = self._source.newest
        if cycle is not None:
            if self._poses.move(cycle.joint_positions if self._poses.joints else np.zeros(0)):
                self.scene.move()
                if not self._is_known:  # the arm as it stands is elsewhere than it was drawn
                    self._is_known = True
                    self.scene.aim()
            drawing = self._drawer.draw(cycle, age_s=self._source.silent_s)
            shown = self.drawing and (self.drawing.number, self.drawing.is_stale)
            if shown != (drawing.number, drawing.is_stale):
                with self.server.atomic():
                    self.scene.show(drawing)
                self.n_drawn += 1
                self.drawing = drawing
        if time.monotonic() - self._panel_s >= PANEL_S:
            self._panel_s = time.monotonic()
            self._show_panels()

    def _build(self, gui: viser.GuiApi) -> None:
        """Make the panels."""
        gui.set_panel_label("skinbus")
        gui.main_panel.dock_right()
        self._head = gui.add_html("")
        self._legend = gui.add_html(panels.legend())
        tabs = gui.add_tab_group()
        with tabs.add_tab("Forces"):
            self._forces: Any = gui.add_uplot(
                (np.array([0.0, 1.0]), np.zeros(2)),
                _series([]),
                title="force, N, over the last 20 s",
                aspect=1.5,
                scales={"x": viser.uplot.Scale(time=False)},
            )
        with tabs.add_tab("Boards"):
            self._boards = gui.add_html("")
        with tabs.add_tab("Cycle"):
            self._cycle = gui.add_html("")
        with tabs.add_tab("Show"):
            full = gui.add_slider("Brightest, kPa", 5.0, 250.0, 5.0, colours.FULL_KPA)

        async def change(_: Any) -> None:
            self._drawer.full_pa = 1e3 * full.value
            self._legend.content = panels.legend(full.value)
            self.drawing = None  # to be drawn anew

        full.on_update(change)

    async def _add_zeros(self, client: viser.ClientHandle) -> None:
        """Add the buttons for zeros to a page that may press them."""
        source = self._source
        if not (source.has_zeros and self.server.may_change(client)):
            return
        names = [panels.board_name(self._arm, p) for p in range(self._arm.n_patches)]
        board = client.gui.add_dropdown("Zero", ("all boards", *names))
        button = client.gui.add_button("Zero", hint="What the tactels read now becomes their zero")

        async def zero(_: Any) -> None:
            patch = None if board.value == "all boards" else names.index(board.value)
            try:
                await asyncio.to_thread(source.zero, patch)
                said = "done"
            except SkinbusError as error:
                said = str(error)
            client.add_notification("skinbus", f"zero {board.value}: {said}", auto_close_seconds=4.0)

        button.on_click(zero)

    def _show_panels(self) -> None:
        source, cycle, drawing = self._source, self._source.newest, self.drawing
        is_stale = drawing is not None and drawing.is_stale
        is_blind = drawing is not None and not (is_stale or drawing.has_readings)
        blind = "no readings from this source: tactels are grey" if is_blind else ""
        notes = (self._poses.note, self.scene.note, blind)
        self._head.content = panels.head(
            self._title, source, cycle, is_stale=is_stale, n_drawn=self.n_drawn, notes=notes
        )
        if cycle is None:
            return
        self._boards.content = panels.boards(cycle, self._arm, self._pressed.of(cycle.readings))
        self._cycle.content = panels.cycle_table(cycle, 1e3 / self._arm.bus.rate_hz)
        times, ids, forces = source.history.forces(len(SERIES))
        with self.server.atomic():  # a plot has as many columns as series
            if ids != self._ids:
                self._ids = ids
                self._forces.series = _series(ids)
            self._forces.data = (times, *(forces.T if ids else times[None] * 0.0))


def _series(ids: list[int]) -> tuple[viser.uplot.Series, ...]:
    """Return the series of a plot of contacts; one without name where there are none."""
    names = [f"id {key}" for key in ids] or ["no contact"]
    return (
        viser.uplot.Series(label="s"),
        *(viser.uplot.Series(label=name, stroke=SERIES[k], width=2) for k, name in enumerate(names)),
    )
