"""Server of the page: viser's, behind checks of origin and token; the page itself, and the drive WebSocket.

viser serves its page and its data on one port, without any check. The gate is in front of both, on the same
port. It rejects requests of other sites' pages, because the same-origin rule does not hold for a WebSocket.
It checks the token if there is one, adds the package's own script to the page, and answers the drive channel.
"""

from __future__ import annotations

import contextlib
import hmac
import http
import io
import ipaddress
import json
import os
import secrets
import socket
import threading
import warnings
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any, Callable, Collection, Dict, Mapping, Optional, Tuple
from urllib.parse import parse_qs, urlsplit

import rospkg
import rospy
import viser
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.frames import CloseCode
from websockets.http11 import Request, Response

from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.paths import share_folder
from husky_highlevel_controller.ros.node import contained
from husky_web.viser_private import page_html, started_behind

DRIVE_PATH = "/drive"
COOKIE = "husky_token"
# file in ROS_HOME with the token, and smallest number of characters of a token
TOKEN_FILE, MIN_TOKEN = "husky_web_token", 16
# [bytes] largest message on the drive channel, the WebSocket on which a page sends its driving commands
MAX_MESSAGE = 1000
# largest number of pages that are open at the same time; each page takes up to 1.6 MB in this process
MAX_PAGES = 20
MAX_PORT = 65535  # largest number of a port
# kinds of connections: an open page has one for its view, which viser handles, and one for the drive channel
VIEW, DRIVE = "view", "drive"
TOO_MANY = f"{MAX_PAGES} pages are open, which is the limit. Close one of them, then load this page again"
LOOPBACK = ("127.0.0.1", "::1", "localhost")
# header Content-Security-Policy of the page: the page may send requests only to its own host; inline scripts
# and workers are allowed, because viser's page needs them
POLICY = "default-src 'self' 'unsafe-inline' 'unsafe-eval' blob: data:; frame-ancestors 'none'"
Message = Dict[str, Any]
OnMessage = Callable[[int, Message], None]
OnLeave = Callable[[int], None]


class PageServer(viser.ViserServer):
    """Server of viser that refuses to share the page through another host."""

    gate: Gate

    def request_share_url(self, verbose: bool = True) -> Optional[str]:
        """Reject the request, because it would open the robot to others."""
        rospy.logwarn("the request of a page to be shared through another host was rejected")
        return None


def serve(host: str, port: int, on_message: OnMessage, on_leave: OnLeave) -> Tuple[PageServer, str, bool]:
    """Start a server, and return it, the address to open, and whether the address has a token.

    If the port is taken, the next free one is used.

    Args:
        host: address of this machine; the server needs a token unless it is a loopback address.
        port: port, 1..65535.
        on_message: function that gets each message of the drive channel, with a number for the page.
        on_leave: function that is called when a page has gone.

    Raises:
        HuskyError: the address is not an address of this machine, or no port is free.
    """
    hosts: Optional[Collection[str]] = None  # names of this machine that a request may use; None for all
    token: Optional[str] = None  # token that a request must have; None if no token is required
    if _is_loopback(host):
        # Only this machine can connect, so no token is needed. But another site may let its own host name
        # point to this machine (DNS rebinding), so a request may use only these names.
        hosts = (*LOOPBACK, host.lower())
    else:
        token = _kept_token()
    # viser also looks for a free port; but if no port is free, only its thread ends, and this program would
    # wait for it forever
    port = _find_free_port(host, port)
    # viser warns if a page has left before a message reaches it, but this is normal
    warnings.filterwarnings("ignore", "Queued a .* on a closed connection")
    gate = Gate(hosts, token, on_message, on_leave)
    # a server that is started inside this context asks the gate about each request, and has the drive channel
    behind_gate = started_behind(gate.answer, gate.with_drive_channel)
    # the output of viser is hidden, because viser prints an address of its own, which has no token
    with behind_gate, contextlib.redirect_stdout(io.StringIO()):
        server = PageServer(host=host, port=port, label="Husky", verbose=False)
    server.gate = gate
    port_and_token = f":{server.get_port()}" + ("" if token is None else f"/?token={token}")
    return server, address_to_open(host, port_and_token), token is not None


def address_to_open(host: str, port_and_token: str) -> str:
    """Return the address of a server that a person opens in a browser, such as http://127.0.0.1:8080.

    Args:
        host: address that the server listens at.
        port_and_token: end of the address, such as :8080 or :8080/?token=abc.
    """
    # at 0.0.0.0 or ::, the server listens on all interfaces, but a browser cannot open such an address
    loopback = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host)
    name = loopback or host
    if ":" in name:  # an address of IPv6
        name = f"[{name}]"
    address = f"http://{name}{port_and_token}"
    if loopback is not None:
        # the loopback address also works for a container, because its published port is a port of this
        # machine; other machines do not know the host name of a container
        address += f" (from another machine: http://{socket.gethostname()}{port_and_token})"
    return address


def _is_loopback(host: str) -> bool:
    """Return whether only this machine can reach an address.

    Raises:
        HuskyError: the address is not an address of this machine.
    """
    try:
        family, _, _, _, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.bind(address)  # fails if the address belongs to another machine
    except OSError as error:
        raise HuskyError(
            f"{rospy.get_name()}/address = '{host}' is not an address of this machine: {error}"
        ) from None
    return ipaddress.ip_address(address[0]).is_loopback


def _find_free_port(host: str, port: int) -> int:
    """Return the first free port of an address, from `port` on.

    Raises:
        HuskyError: `port` and all ports above it are in use.
    """
    family, _, _, _, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
    for candidate in range(port, MAX_PORT + 1):
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            # otherwise a port whose server has just ended would count as in use for a minute
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            with contextlib.suppress(OSError):
                probe.bind((address[0], candidate, *address[2:]))
                return candidate
    raise HuskyError(
        f"{rospy.get_name()}/port = {port}: this port and all ports above it are in use; choose a lower one"
    )


def _kept_token() -> str:
    """Return the token of all pages of this user, which is made only once and kept in a file.

    After a restart, a page that is still open, and an emergency stop that it has to send, can connect again
    only with the token that the page knows. All pages have the same token, because a browser sends the cookie
    of one page to all ports of the host.
    """
    path = Path(rospkg.get_ros_home()) / TOKEN_FILE
    try:
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            # only the user can read this file
            with NamedTemporaryFile("w", dir=path.parent) as file:
                file.write(secrets.token_urlsafe(16))
                file.flush()
                with contextlib.suppress(FileExistsError):  # another page has made the token meanwhile
                    os.link(file.name, path)
        token = path.read_text(encoding="ascii").strip()
        if len(token) >= MIN_TOKEN:
            return token
        problem = f"its token has fewer than {MIN_TOKEN} characters; delete the file"
    except (OSError, ValueError) as error:
        problem = str(error)
    rospy.logwarn(
        f"{path}: {problem}. This page uses a new token, so it must be opened by its new address after each"
        " start"
    )
    return secrets.token_urlsafe(16)


def refusal(
    headers: Mapping[str, str], path: str, hosts: Optional[Collection[str]], token: Optional[str]
) -> Optional[str]:
    """Return the reason why a request must be rejected, or None if it is allowed.

    Args:
        headers: headers of the request.
        path: path of the request, with its query.
        hosts: names of the server that a request may use; None if all names are allowed.
        token: required token in the address or as a cookie; None if no token is required.
    """
    host = headers.get("Host", "")
    # another site may let its own host name point to the loopback address (DNS rebinding), so the name is
    # checked
    if hosts is not None and (urlsplit(f"//{host}").hostname or "") not in hosts:
        return f"this page can be opened at {', '.join(sorted(set(hosts)))} only, not at '{host}'"
    # address of the page that sends the request; None if the request does not come from a page
    origin = headers.get("Origin")
    if origin is not None and urlsplit(origin).netloc != host:
        return f"the page of another site ('{origin}') may not act on the robot"
    if token is not None and not _has_token(token, headers, path):
        return "the address needs its token; use the address that the node has printed"
    return None


def _has_token(token: str, headers: Mapping[str, str], path: str) -> bool:
    """Return whether a request has the token, in the query of its path or as a cookie."""
    tokens = list(parse_qs(urlsplit(path).query).get("token", []))
    try:
        cookie = SimpleCookie(headers.get("Cookie", "")).get(COOKIE)
    except CookieError:
        cookie = None
    if cookie is not None:
        tokens.append(cookie.value)
    # `compare_digest` takes equally long for every wrong token, so its time does not help to guess the token
    return any(hmac.compare_digest(item.encode(), token.encode()) for item in tokens)


def page() -> bytes:
    """Return viser's page with the package's scripts and styles."""
    folder = share_folder() / "web"
    html = page_html().replace("<title>Viser</title>", "<title>Husky</title>")
    additions = [f"<script>{(folder / name).read_text()}</script>" for name in ("viser_client.js", "page.js")]
    additions += [f"<style>{(folder / name).read_text()}</style>" for name in ("viser.css", "page.css")]
    # the additions are the first elements of the head, so that their scripts run before the scripts of viser
    at = html.index("<head>") + len("<head>")
    return f"{html[:at]}{''.join(additions)}{html[at:]}".encode()


class Gate:
    """Checks every request, serves the page, and reads the drive channel."""

    def __init__(
        self,
        hosts: Optional[Collection[str]],
        token: Optional[str],
        on_message: OnMessage,
        on_leave: OnLeave,
    ) -> None:
        """Begin without connections.

        Args:
            hosts: names of the server that a request may use; None if all names are allowed.
            token: token that a request must have; None if no token is required.
            on_message: function that gets each message of the drive channel, with a number for the page.
            on_leave: function that is called with this number when a page has gone.
        """
        self._hosts, self._token, self._page = hosts, token, page()
        self._on_message, self._on_leave = on_message, on_leave
        self._connections = {VIEW: 0, DRIVE: 0}  # number of open connections of each kind
        # set when the last connection ends; `last_has_gone` reads and clears it in another thread
        self._is_empty_again = threading.Event()

    def answer(self, _connection: Any, request: Request) -> Optional[Response]:
        """Return an HTTP response, or None for a WebSocket that may be opened."""
        reason = refusal(request.headers, request.path, self._hosts, self._token)
        if reason is not None:
            return _response(http.HTTPStatus.FORBIDDEN, reason.encode(), "text/plain; charset=utf-8")
        if request.headers.get("Upgrade", "").lower() == "websocket":
            # The answer None opens the WebSocket. The limit of connections is checked later, in
            # `with_drive_channel`, because two requests that come together would both pass a check here.
            return None
        # each open page has one connection for its view, so this is the number of open pages
        if self._connections[VIEW] >= MAX_PAGES:
            return _response(
                http.HTTPStatus.SERVICE_UNAVAILABLE, TOO_MANY.encode(), "text/plain; charset=utf-8"
            )
        if urlsplit(request.path).path not in ("/", "/index.html"):
            return _response(http.HTTPStatus.NOT_FOUND, b"there is only /", "text/plain; charset=utf-8")
        response = _response(http.HTTPStatus.OK, self._page, "text/html; charset=utf-8")
        if self._token is not None:
            # with this cookie, the WebSockets of the page have the token, too
            response.headers["Set-Cookie"] = f"{COOKIE}={self._token}; HttpOnly; SameSite=Strict; Path=/"
        return response

    def with_drive_channel(self, handler: Any) -> Any:
        """Return a handler of all connections; `handler` of viser gets those that are not drive channels."""

        async def handle(connection: Any) -> None:
            """Handle a connection until the page disconnects, unless too many are open."""
            kind = DRIVE if urlsplit(connection.request.path).path == DRIVE_PATH else VIEW
            if self._connections[kind] >= MAX_PAGES:
                await connection.close(CloseCode.TRY_AGAIN_LATER, TOO_MANY)
                return
            self._connections[kind] += 1
            try:
                # both functions return only when the page disconnects
                if kind == DRIVE:
                    await self._read_drive_channel(connection)
                else:
                    await handler(connection)
            finally:
                self._connections[kind] -= 1
                if not any(self._connections.values()):
                    self._is_empty_again.set()  # the node asks for it by `last_has_gone`

        return handle

    def last_has_gone(self) -> bool:
        """Return whether the last connection has ended since the last call. Any thread."""
        has_gone = self._is_empty_again.is_set()
        self._is_empty_again.clear()
        return has_gone

    async def _read_drive_channel(self, connection: Any) -> None:
        """Pass the messages of a page on until it disconnects, and confirm each emergency stop."""
        page_number = id(connection)  # distinguishes the pages that are open at the same time
        try:
            async for text in connection:
                message = _parse(text)
                if message is None:  # the message is not valid
                    continue
                is_done = False
                with contained("a message of the page"):  # an error is logged, and the loop continues
                    self._on_message(page_number, message)
                    is_done = True
                # the page sends an emergency stop again if it is not confirmed, because the network may have
                # lost it
                if is_done and isinstance(message.get("e_stop"), bool):
                    await connection.send(json.dumps({"e_stop": message["e_stop"]}))
        except ConnectionClosed:
            pass
        finally:
            self._on_leave(page_number)


def _parse(text: Any) -> Optional[Message]:
    """Return a message of the drive channel; None if it is too long or not a JSON object."""
    if len(text) > MAX_MESSAGE:
        return None
    try:
        message = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return message if isinstance(message, dict) else None


def _response(status: http.HTTPStatus, body: bytes, kind: str) -> Response:
    """Return a response with a body of a content type `kind`, and with headers that protect the page.

    The browser must not keep the response, guess its type, or tell its address to other sites.
    """
    headers = Headers(
        {
            "Content-Type": kind,
            "Content-Length": str(len(body)),
            "Content-Security-Policy": POLICY,
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
            "Cache-Control": "no-store",
            "Connection": "close",
        }
    )
    return Response(status.value, status.phrase, headers, body)
