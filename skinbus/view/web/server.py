"""The server of the page: viser's without a share link, closed to pages of other sites."""

from __future__ import annotations

from contextlib import redirect_stdout
from io import StringIO
from ipaddress import ip_address
from typing import Final
from urllib.parse import urlsplit

import viser
from viser._messages import RunJavascriptMessage
from viser.infra import WebsockClientConnection

COARSE: Final = """
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
    """A viser server without share link, whose buttons no page of another site can press."""

    def __init__(self, host: str, port: int) -> None:
        """Serve at an address; what viser prints of itself is left out.

        Raises:
            SkinbusError: no port can be had.
        """
        with redirect_stdout(StringIO()):
            super().__init__(host=host, port=port, verbose=False)
        self._websock_server.on_client_connect(self._refuse_strangers)
        self._websock_server.queue_message(RunJavascriptMessage(source=COARSE))

    async def _refuse_strangers(self, client: WebsockClientConnection) -> None:
        """Close a connection that a page of another site has opened: browsers allow them to."""
        connection = self._websock_server._live_connections[client.client_id]
        headers = connection.request.headers if connection.request else {}
        origin, host = headers.get("Origin"), headers.get("Host", "")
        if origin is not None and not is_own(origin, host, self.get_host()):
            await connection.close(1008, "opened by a page of another site")

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Return nothing: a share link would carry the page, and its buttons, through somebody's server."""
        return None


def is_own(origin: str, host: str, served_at: str) -> bool:
    """Whether the origin of a page is the server that it connects to, under a name that is its own.

    A name that somebody else's name server leads here is not: it would make any site the origin.
    """
    name = urlsplit(f"//{host}").hostname or ""
    return urlsplit(origin).netloc == host and (name == served_at or name == "localhost" or is_address(name))


def is_address(name: str) -> bool:
    """Whether a name is an address of IP."""
    try:
        ip_address(name)
    except ValueError:
        return False
    return True
