"""The server of the page: on the loopback interface only, and for pages of its own.

A browser that shows another web site could otherwise be made to reach a server on its own machine.
"""

import socket
import webbrowser
from collections.abc import Awaitable, Callable
from typing import Any

from aiohttp import web

from sdm_deflect.cases.view.page import Page
from sdm_deflect.deform.errors import InputError

HOST = "127.0.0.1"
HOSTS = frozenset({HOST, "localhost"})

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


def serve(page: Page, port: int, show: bool) -> None:
    """Serve the page until interrupted; print its address, and open it in the user's browser if that is wanted.

    Raises InputError if the port is taken.
    """
    port = port or free_port()
    check_free(port)

    def ready(**_: Any) -> None:
        address = f"http://{HOST}:{page.server.port}/"
        print(f"{address}  (Ctrl-C ends it)", flush=True)  # noqa: T201 - the command's answer
        if show:
            webbrowser.open(address)

    page.server.controller.on_server_ready.add(ready)
    page.server.controller.on_server_bind.add(guard)
    page.server.start(
        port=port,
        host=HOST,
        open_browser=False,
        show_connection_info=False,
        disable_logging=True,
        backend="aiohttp",
        timeout=0,
        exec_mode="main",
    )


def check_free(port: int) -> None:
    """Raise InputError if something listens on the port."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError as error:
            raise InputError(
                f"--port {port} cannot be used: {error.strerror}; give another, or none to have a free one chosen"
            ) from None


def free_port() -> int:
    """Return a port that is free now."""
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        return int(probe.getsockname()[1])


@web.middleware
async def own_pages_only(request: web.Request, handler: Handler) -> web.StreamResponse:
    """Answer only requests to a loopback name, and from a page of this very server."""
    origin = request.headers.get("Origin")
    if request.host.partition(":")[0] not in HOSTS or (origin and origin != f"http://{request.host}"):
        raise web.HTTPForbidden(text="this page is served to its own machine only")
    if request.path == "/ws" and "Upgrade" not in request.headers:
        raise web.HTTPBadRequest(text="this address is for the page's own connection")
    return await handler(request)


def guard(server: Any) -> None:
    """Let a server, before it starts, answer such requests only."""
    server.app.middlewares.append(own_pages_only)
