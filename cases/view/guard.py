"""Keeps other web sites out: a browser that shows one could otherwise reach a server on its own machine."""

from collections.abc import Awaitable, Callable
from typing import Any
from urllib.parse import urlsplit

from aiohttp import web

HOSTS = frozenset({"127.0.0.1", "localhost"})

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


@web.middleware
async def own_pages_only(request: web.Request, handler: Handler) -> web.StreamResponse:
    """Answer only requests to a loopback name, and from a page that came from one."""
    origin = request.headers.get("Origin")
    asked = [urlsplit(f"//{request.host}").hostname, *([urlsplit(origin).hostname] if origin else [])]
    if not HOSTS.issuperset(asked):
        raise web.HTTPForbidden(text="this page is served to its own machine only")
    return await handler(request)


def guard(server: Any) -> None:
    """Let a server, before it starts, answer such requests only."""
    server.app.middlewares.append(own_pages_only)
