"""The server of the page: on the loopback interface only, for the user and this page.

A browser that shows another web site could otherwise be made to reach a server on its own machine.
"""

import asyncio
import json
import logging
import os
import socket
import webbrowser
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from hmac import compare_digest
from secrets import token_urlsafe
from threading import Thread
from typing import TYPE_CHECKING, Any

from aiohttp import WSCloseCode, WSMsgType, web

from sdm_deflect.deform.base.errors import InputError

if TYPE_CHECKING:
    from .page import View

HOST = "127.0.0.1"
HOSTS = frozenset({HOST, "localhost"})
SSH = "SSH_CONNECTION"
"""Environment variable of a user who came from another machine."""
LARGEST = 1 << 12
"""Bytes of a message from the page; its own have some fifty."""
CONNECTIONS = 16
"""Connections at a time."""
HEADERS = {"Cache-Control": "no-store", "Referrer-Policy": "no-referrer", "X-Frame-Options": "DENY"}

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


def bound(port: int) -> socket.socket:
    """Return a socket on a port of the loopback interface, 0 for a free one; InputError if it is taken."""
    own = socket.socket()
    own.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        own.bind((HOST, port))
    except OSError as error:
        own.close()
        sentence = f"--port {port} cannot be used: {error.strerror}; give another, or none to have a free one chosen"
        raise InputError(sentence) from None
    own.listen()
    return own


def announce(own: socket.socket) -> str:
    """Print the address of the page to come, and return it; a browser that opens it waits for the page."""
    port = own.getsockname()[1]
    address = f"http://{HOST}:{port}/?secret={token_urlsafe(24)}"
    print(f"{address}  (Ctrl-C ends it)", flush=True)  # noqa: T201 - the command's answer
    if SSH in os.environ:
        tunnel = f"ssh -N -L {port}:{HOST}:{port} {socket.gethostname()}"
        print(f"from another machine first: {tunnel}", flush=True)  # noqa: T201 - part of the answer
    return address


def serve(own: socket.socket, address: str, page: str, view: "View | None", show: bool) -> None:
    """Serve a page at the announced address until interrupted; open it in the user's browser if that is wanted."""
    logging.getLogger("aiohttp").setLevel(logging.CRITICAL + 1)  # it prints a traceback for each bad request
    desk = Desk(own.getsockname()[1], address.partition("=")[2], page, view)
    application = web.Application(middlewares=[desk.guard])
    application.router.add_get("/", desk.lead)
    application.router.add_get("/ws", desk.talk)
    application.on_startup.append(desk.start)
    application.on_shutdown.append(desk.close)

    def ready(*_: str) -> None:
        if show:
            webbrowser.open(address)

    web.run_app(application, sock=own, print=ready, access_log=None, shutdown_timeout=1.0)


@dataclass(slots=True, eq=False)
class Desk:
    """Who may have the page, and what is answered to it; each connection has an angle of its own.

    Attributes
    ----------
    port : of the server.
    secret : part of the printed address; a browser that has shown it once keeps it as a cookie until it is closed.
    page : the page.
    view : the run that it turns; None if it only shows a mesh.
    spans : what the angles are that can be reached, once they are known.
    sockets : the connections.
    """

    port: int
    secret: str = field(repr=False)
    page: str = field(repr=False)
    view: "View | None"
    spans: dict[str, Any] | None = None
    sockets: set[web.WebSocketResponse] = field(default_factory=set, repr=False)

    async def start(self, _: web.Application) -> None:
        """Begin to look for the angles that can be reached, which takes longer than all else."""
        if self.view is None:
            return
        loop, view = asyncio.get_running_loop(), self.view

        def find() -> None:
            words = view.spans()
            loop.call_soon_threadsafe(lambda: loop.create_task(self._tell(words)))

        Thread(target=find, daemon=True).start()

    async def close(self, _: web.Application) -> None:
        """Close all connections."""
        for one in set(self.sockets):
            await one.close(code=WSCloseCode.GOING_AWAY)

    async def lead(self, request: web.Request) -> web.Response:
        """Answer by the page, and give the secret to the browser."""
        response = web.Response(text=self.page, content_type="text/html", headers=HEADERS)
        response.set_cookie(f"sdm-view-{self.port}", self.secret, httponly=True, samesite="Strict")
        return response

    async def talk(self, request: web.Request) -> web.StreamResponse:
        """Answer the messages of a page; one that is too large, or none, ends the connection."""
        own = web.WebSocketResponse(max_msg_size=LARGEST, heartbeat=30.0)
        if self.view is None or not own.can_prepare(request):
            raise web.HTTPBadRequest(text="this address is for the page's own connection")
        if len(self.sockets) >= CONNECTIONS:
            raise web.HTTPServiceUnavailable(text=f"the page is open {CONNECTIONS} times; close one")
        self.sockets.add(own)
        try:
            await own.prepare(request)
            if self.spans:
                await own.send_json(self.spans)
            frame = None
            async for message in own:
                wish = _wish(message.data) if message.type is WSMsgType.TEXT else None
                if wish is None:
                    await own.close(code=WSCloseCode.INVALID_TEXT)
                    break
                answer, frame = await asyncio.to_thread(self.view.answer, wish, frame)
                await (own.send_bytes(answer) if isinstance(answer, bytes) else own.send_json(answer))
        finally:
            self.sockets.discard(own)
        return own

    @web.middleware
    async def guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Answer a request that is whole, of this very address, of this page and knows the secret."""
        origin, given = request.headers.get("Origin"), request.query.get("secret", "")
        if request.headers.get("Host") not in {f"{host}:{self.port}" for host in HOSTS}:
            raise web.HTTPBadRequest(text="this is not the address of this page")
        kept = request.cookies.get(f"sdm-view-{self.port}", "")
        if (not self._is_secret(given) and not self._is_secret(kept)) or origin not in (None, f"http://{request.host}"):
            raise web.HTTPForbidden(text="open the address that sdm view has printed")
        return await handler(request)

    def _is_secret(self, text: str) -> bool:
        return compare_digest(text.encode("utf-8", "surrogateescape"), self.secret.encode())

    async def _tell(self, spans: dict[str, Any]) -> None:
        self.spans = spans
        for one in set(self.sockets):
            if one.prepared and not one.closed:
                await one.send_json(spans)


def _wish(text: str) -> dict[str, Any] | None:
    """Return what a message says; None if it is none."""
    try:
        found = json.loads(text)
    except (RecursionError, ValueError):
        return None
    return found if isinstance(found, dict) else None
