"""The server of the page: on the loopback interface only, for the user and pages of its own.

A second tab or browser gets a page, and a server, of its own, so that none turns what another shows.

A browser that shows another web site could otherwise be made to reach a server on its own machine.
"""

import asyncio
import logging
import os
import socket
import webbrowser
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from functools import partial
from hmac import compare_digest
from secrets import token_urlsafe
from typing import Any

from aiohttp import WSCloseCode, web

from sdm_deflect.cases.view.page import Control, Page
from sdm_deflect.deform.base.errors import InputError

HOST = "127.0.0.1"
HOSTS = frozenset({HOST, "localhost"})

SSH = "SSH_CONNECTION"
"""Environment variable of a user who came from another machine."""
PAGES = frozenset({"/", "/index.html"})
LARGEST, PENDING = 1 << 20, 4
"""Bytes of a message from the page, and messages of which parts are awaited; the page's own have some hundred bytes."""
CONNECTIONS = 16
"""Connections at a time, of each page."""
PAGES_AT_ONCE = 8
MALFORMED = (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError)
"""What the library raises on messages that are none."""

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


def serve(page: Page, port: int, show: bool) -> None:
    """Serve the page until interrupted; print its address, and open it in the user's browser if that is wanted.

    Raises InputError if the port is taken.
    """
    port = port or free_port()
    check_free(port)
    for library in ("aiohttp", "trame_server", "wslink"):  # they print a traceback or a line for each bad request
        logging.getLogger(library).setLevel(logging.CRITICAL + 1)
    desk = Desk(page.control, token_urlsafe(24))

    def ready(address: str) -> None:
        print(f"{address}  (Ctrl-C ends it)", flush=True)  # noqa: T201 - the command's answer
        if SSH in os.environ:
            tunnel = f"ssh -N -L {port}:{HOST}:{port} {socket.gethostname()}"
            print(f"from another machine first: {tunnel}", flush=True)  # noqa: T201 - part of the answer
        if show:
            webbrowser.open(address)

    desk.open(page, port, ready, "main")


@dataclass(frozen=True, slots=True)
class Desk:
    """Pages of one run, each with a server and a state of its own.

    Attributes
    ----------
    control : of the first page; others share what is costly in it.
    secret : of all pages.
    guards : of each page's server.
    """

    control: Control
    secret: str
    guards: list["Guard"] = field(default_factory=list, repr=False)

    def open(self, page: Page, port: int, ready: Callable[[str], None], mode: str) -> None:
        """Start the server of a page; `ready` is told its address."""
        guard = Guard(port, self.secret, self.another)
        self.guards.append(guard)
        page.server.controller.on_server_ready.add(lambda **_: ready(guard.address))
        page.server.controller.on_server_bind.add(lambda server: guard.over(page.server, server))
        page.server.start(
            port=port,
            host=HOST,
            open_browser=False,
            show_connection_info=False,
            disable_logging=True,
            backend="aiohttp",
            timeout=0,
            exec_mode=mode,
        )

    async def another(self) -> str:
        """Return the address of a page that no browser shows, if there need be of a new one."""
        free = [guard.address for guard in self.guards if not guard.busy]
        if free:
            return free[0]
        if len(self.guards) >= PAGES_AT_ONCE:
            raise web.HTTPServiceUnavailable(text=f"{PAGES_AT_ONCE} pages are open; close one")
        opened: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        self.open(Page(self.control.for_another_page()), free_port(), opened.set_result, "task")
        return await opened


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


@dataclass(frozen=True, slots=True)
class Guard:
    """Who may speak to a server, and how much: browsers of this machine that know its secret.

    A page of another web site does not; nor does another user of the machine.

    Attributes
    ----------
    port : of the server.
    secret : part of the printed address; a browser that has shown it once keeps it as a cookie until it is closed.
    another : gives the address of another page, for a browser that comes while this one is shown.
    handlers : of the server's connections.
    """

    port: int
    secret: str
    another: Callable[[], Awaitable[str]] = field(repr=False)
    handlers: list[Any] = field(default_factory=list, repr=False)

    @property
    def address(self) -> str:
        """Of the page, with the secret."""
        return f"http://{HOST}:{self.port}/?secret={self.secret}"

    @property
    def busy(self) -> bool:
        """True while a browser shows the page."""
        return any(one.connections for one in self.handlers)

    @property
    def cookie(self) -> str:
        """Name of the cookie; a browser has one jar for all ports of a machine."""
        return f"sdm-view-{self.port}"

    def over(self, page: Any, server: Any) -> None:
        """Put a server, before it starts, under guard."""
        page.protocol.updateSecret(self.secret)
        server.app.middlewares.append(self.answer)
        self.handlers.extend(server._ws_handlers)
        for handler in self.handlers:
            handler.onMessage = partial(received, handler)

    @web.middleware
    async def answer(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Answer a request that is whole, of this very address, of an own page and knows the secret."""
        origin, given = request.headers.get("Origin"), request.query.get("secret", "")
        if request.headers.get("Host") not in {f"{host}:{self.port}" for host in HOSTS}:
            raise web.HTTPBadRequest(text="this is not the address of this page")
        known = self._is_secret(given) or self._is_secret(request.cookies.get(self.cookie, ""))
        if not known or origin not in (None, "", f"http://{request.host}"):
            raise web.HTTPForbidden(text="open the address that sdm view has printed")
        if request.path == "/ws":
            self._check_connection(request)
        if request.path in PAGES:
            await self._lead(request, bool(given))
        response = await handler(request)
        if given and not response.prepared:
            response.set_cookie(self.cookie, self.secret, httponly=True, samesite="Strict")
        return response

    def _check_connection(self, request: web.Request) -> None:
        """Refuse what is no connection of the page, and one too many."""
        if not web.WebSocketResponse().can_prepare(request):
            raise web.HTTPBadRequest(text="this address is for the page's own connection")
        if sum(len(handler.connections) for handler in self.handlers) >= CONNECTIONS:
            raise web.HTTPServiceUnavailable(text=f"the page is open {CONNECTIONS} times; close one")

    async def _lead(self, request: web.Request, given: bool) -> None:
        """Lead a browser to a page of its own, and one that loads its page again to the address with the secret."""
        if self.busy and _comes_anew(request):
            raise web.HTTPFound(await self.another())
        if not given:  # the page has taken the secret out of its address
            raise web.HTTPFound(f"/index.html?secret={self.secret}")

    def _is_secret(self, text: str) -> bool:
        return compare_digest(text.encode("utf-8", "surrogateescape"), self.secret.encode())


def _comes_anew(request: web.Request) -> bool:
    """Whether a browser goes to a page; of one that loads its page again the old one is still connected."""
    again = request.headers.get("Cache-Control", "") in ("max-age=0", "no-cache")
    return request.headers.get("Sec-Fetch-Mode") == "navigate" and not again


async def received(handler: Any, binary: bool, message: Any, client: str) -> None:
    """Take a part of a message from the page; one that is too large, or no message, ends the connection.

    A part begins with 12 bytes: the number of its message, the part's place in it and the size of the whole. The
    library sets aside as much memory as is announced.
    """
    unchunker = handler.unchunkers[client]
    try:
        known = unchunker.pending_messages.keys()
        if not binary or not len(message.data) > 12 or int.from_bytes(message.data[8:12], "little") > LARGEST:
            raise ValueError("no part of a message")
        if int.from_bytes(message.data[:4], "little") not in known and len(known) >= PENDING:
            raise ValueError("too many messages at once")
        whole = unchunker.process_chunk(message.data)
        if whole is not None:
            await handler.onCompleteMessage(whole, client)
    except MALFORMED:
        await handler.connections[client].close(code=WSCloseCode.INVALID_TEXT)
