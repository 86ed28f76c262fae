"""A site without a scene, on a port of this computer, under the rule of `Access`."""

from __future__ import annotations

import asyncio
import http
import threading
from typing import Self

from suta_calib.optional_packages import load
from suta_calib.view.access import Access, Site, check_port


class SiteServer:
    """Serves a site from a thread; a context manager.

    Args:
        site: what is served.
        port: to listen on; 0 for any that is free.
        host: who may look, as of `Viewer`.

    Raises:
        MissingExtraError: the extra ``view`` is not installed.
        OutputError: the port cannot be had.
    """

    def __init__(self, site: Site, port: int = 8080, host: str = "127.0.0.1") -> None:
        self._access, self._site, self._host = Access(host, site), site, host
        self._serve = load("websockets.asyncio.server", "view").serve
        check_port(port, host)
        self._over, self._there = asyncio.Event(), threading.Event()
        self._port = port
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self._run()), name="page", daemon=True
        )

    def __enter__(self) -> Self:
        self._thread.start()
        self._there.wait()
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.call_soon_threadsafe(self._over.set)
        self._thread.join(2.0)

    @property
    def url(self) -> str:
        """Where to look: the address, with the key that the server asks for."""
        host = f"[{self._host}]" if ":" in self._host else self._host
        return f"http://{host}:{self._port}/{self._access.token}/"

    async def _run(self) -> None:
        self._loop = asyncio.get_running_loop()
        check = self._access.checked(
            lambda connection, _: connection.respond(http.HTTPStatus.NOT_FOUND, "No scene here.\n")
        )
        serving = self._serve(
            self._site.talk, self._host, self._port, process_request=check, compression=None
        )
        async with serving as server:
            self._port = server.sockets[0].getsockname()[1]
            self._there.set()
            await self._over.wait()
