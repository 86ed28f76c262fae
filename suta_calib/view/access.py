"""Who may look at a scene: whoever has the address that was printed, and no other web page.

Any page that a browser shows can send requests to this computer's ports, and a name that its
owner points at 127.0.0.1 (DNS rebinding) makes them look like requests of the same site. So the
address has a random part, and what a request says of where it comes from (``Host``, ``Origin``) is
checked. viser itself asks for neither: it is served through `Access.guarding`. A `Site` stands on
the same port, under the same rule.
"""

from __future__ import annotations

import errno
import http
import ipaddress
import logging
import secrets
import socket
import threading
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Protocol
from urllib.parse import urlsplit

from suta_calib.errors import OutputError
from suta_calib.optional_packages import load

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

    Answer = Callable[[ServerConnection, Request], Response | None]
    Handler = Callable[[ServerConnection], Awaitable[None]]

# What the server's library says of requests that fail goes here, and is heard only by a program
# that sets up logging: broken requests are no news, and their tracebacks help no user.
_LOGGER: Final = logging.getLogger(__name__)
_LOGGER.addHandler(logging.NullHandler())
_THIS_COMPUTER: Final = frozenset({"localhost", "127.0.0.1", "::1"})
_EVERY_ADDRESS: Final = frozenset({"", "0.0.0.0", "::"})
# `serve` of the library is exchanged for a moment: by one at a time.
_EXCHANGING: Final = threading.Lock()


@dataclass(frozen=True)
class Page:
    """What is answered to a request: its content, and what that is (a media type)."""

    content: bytes
    media: str


class Site(Protocol):
    """Pages beside a scene, which then stands below ``/scene/``; and whoever talks with them."""

    def page(self, path: str) -> Page | None:
        """What stands at a path, such as ``/``; None for nothing."""

    async def talk(self, connection: ServerConnection) -> None:
        """Serve one page that opened a web socket at ``/talk``, until it is closed."""


_SCENE: Final = "/scene"
_TALK: Final = "/talk"


class Access:
    """The rule for one server.

    Args:
        host: what the server listens on.
        site: pages beside the scene.

    Attributes:
        token: what the path of every request begins with.
        guards: whether a server answers by this rule.
    """

    def __init__(self, host: str, site: Site | None = None) -> None:
        token_bytes = 16
        self.token = secrets.token_hex(token_bytes)
        self._host, self._site = host.lower(), site
        self.guards = False

    def refusal(self, request: Request) -> str | None:
        """Why a request is not answered, in words; None for one that is."""
        hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        if len(hosts) != 1 or not self._is_ours(hosts[0]):
            return "the address is of another computer"
        if len(origins) > 1 or (origins and urlsplit(origins[0]).netloc != hosts[0]):
            return "another page asks"
        first = request.path.partition("?")[0].split("/")[1:2]
        if not first or not secrets.compare_digest(first[0].encode(), self.token.encode()):
            return "the address has no key; open the address that was printed"
        return None

    def _is_ours(self, host: str) -> bool:
        """Whether a header ``Host`` names this computer, through whatever port it was reached."""
        try:
            name = urlsplit(f"//{host}").hostname or ""
        except ValueError:
            return False
        if name in _THIS_COMPUTER or name == self._host:
            return True
        if self._host not in _EVERY_ADDRESS:
            return False
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return name.partition(".")[0] == socket.gethostname().partition(".")[0].lower()
        return True

    def checked(self, answer: Answer) -> Answer:
        """``answer`` for requests that may be answered, with the path that it expects."""

        def checked(connection: ServerConnection, request: Request) -> Response | None:
            try:
                refused = self.refusal(request)
            except ValueError:
                refused = "its headers cannot be read"
            if refused is not None:
                return connection.respond(http.HTTPStatus.FORBIDDEN, f"Refused: {refused}.\n")
            path = request.path.removeprefix(f"/{self.token}")
            if self._site is not None:
                if not path.startswith(_SCENE):
                    return self._own(connection, request, path)
                path = path.removeprefix(_SCENE)
            if request.headers.get_all("Upgrade"):
                version = load("viser", "view").__version__
                offered = ",".join(request.headers.get_all("Sec-WebSocket-Protocol"))
                if f"viser-v{version}" not in offered.replace(" ", "").split(","):
                    text = f"Refused: this is viser {version}; reload the page.\n"
                    return connection.respond(http.HTTPStatus.BAD_REQUEST, text)
            response = answer(connection, replace(request, path=path if path[:1] == "/" else "/"))
            if response is not None:
                # The address is a key: it goes to nobody else.
                response.headers["Referrer-Policy"] = "no-referrer"
            return response

        return checked

    def _own(self, connection: ServerConnection, request: Request, path: str) -> Response | None:
        """The answer to a request of the site; None for who may talk with it."""
        assert self._site is not None
        path = path.partition("?")[0] or "/"
        if request.headers.get_all("Upgrade"):
            if path == _TALK:
                return None
            return connection.respond(http.HTTPStatus.NOT_FOUND, "Nothing is here.\n")
        page = self._site.page(path)
        if page is None:
            return connection.respond(http.HTTPStatus.NOT_FOUND, "Nothing is here.\n")
        headers = {
            "Content-Type": page.media,
            "Content-Length": str(len(page.content)),
            "Cache-Control": "no-store",
            "Referrer-Policy": "no-referrer",
            "Connection": "close",
        }
        response = connection.respond(http.HTTPStatus.OK, "")
        response.headers.clear()
        response.headers.update(headers)
        response.body = page.content
        return response

    def _talking(self, scene: Handler) -> Handler:
        """Who serves a web socket: the site, or the scene."""
        site = self._site
        if site is None:
            return scene

        async def talking(connection: ServerConnection) -> None:
            request = connection.request
            if request is not None and request.path == f"/{self.token}{_TALK}":
                await site.talk(connection)
            else:
                await scene(connection)

        return talking

    @contextmanager
    def guarding(self) -> Iterator[None]:
        """Within it, a server of viser's that starts answers by this rule; `guards` says so."""
        library: Any = load("websockets.asyncio.server", "view")
        plain = library.serve

        def serve(handler: Any, *args: Any, process_request: Answer, **options: Any) -> Any:
            self.guards = True
            check = self.checked(process_request)
            talk = self._talking(handler)
            return plain(talk, *args, process_request=check, logger=_LOGGER, **options)

        with _EXCHANGING:
            library.serve = serve
            try:
                yield
            finally:
                library.serve = plain


def check_port(port: int, host: str) -> None:
    """Refuse a port that cannot be listened on.

    Raises:
        OutputError: another program has it, or the host is not this computer.
    """
    try:
        socket.create_server((host, port)).close()
    except OSError as error:
        taken = error.errno == errno.EADDRINUSE
        problem = "another program that listens there" if taken else error.strerror or str(error)
        raise OutputError(
            f"{host}:{port}: found {problem}; expected a free port of this computer; "
            "choose another with --port, or --host"
        ) from None
