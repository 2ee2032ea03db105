"""Access control of the page: checks of origin and token, delivery of the page, the drive WebSocket.

viser serves its page and its data on one port and asks for nothing. The gate stands before both, on the
same port: it refuses requests of other sites' pages (a WebSocket knows no same-origin rule), asks for the
token where there is one, adds the package's own script to the page, and answers the drive channel itself.
"""

from __future__ import annotations

import hmac
import http
import json
from http.cookies import CookieError, SimpleCookie
from typing import Any, Callable, ContextManager, Dict, Mapping, Optional
from urllib.parse import parse_qs, urlsplit

from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from husky_highlevel_controller.paths import share_folder
from husky_highlevel_controller.ros.web.viser_private import page_html, started_behind

DRIVE_PATH = "/drive"
COOKIE = "husky_token"
MAX_MESSAGE = 1000  # [B] on the drive channel
LOOPBACK = {"127.0.0.1", "localhost", "::1"}
# the browser refuses requests to any other host; viser's page unpacks itself by script and runs workers
POLICY = "default-src 'self' 'unsafe-inline' 'unsafe-eval' blob: data:; frame-ancestors 'none'"
Message = Dict[str, Any]


def refusal(headers: Mapping[str, str], path: str, is_loopback: bool, token: Optional[str]) -> Optional[str]:
    """Reason why a request is refused, or None.

    Args:
        headers: of the request.
        path: of the request, with its query.
        is_loopback: the server is bound to the loopback interface only.
        token: to be shown in the address or as a cookie; None: no token is asked for.
    """
    host = headers.get("Host", "")
    if is_loopback and (urlsplit(f"//{host}").hostname or "") not in LOOPBACK:
        return f"this page is for {', '.join(sorted(LOOPBACK))} only, not for '{host}'"
    origin = headers.get("Origin")
    if origin is not None and urlsplit(origin).netloc != host:
        return f"the page of another site ('{origin}') may not act on the robot"
    if token is not None and not _shows(token, headers, path):
        return "the address needs its token: use the address that the node has printed"
    return None


def _shows(token: str, headers: Mapping[str, str], path: str) -> bool:
    tokens = [*parse_qs(urlsplit(path).query).get("token", [])]
    try:
        cookie = SimpleCookie(headers.get("Cookie", "")).get(COOKIE)
    except CookieError:
        cookie = None
    if cookie is not None:
        tokens.append(cookie.value)
    return any(hmac.compare_digest(item.encode(), token.encode()) for item in tokens)


def page() -> bytes:
    """Viser's page with the package's script and style."""
    html, folder = page_html().replace("<title>Viser</title>", "<title>Husky</title>"), share_folder() / "web"
    script, style = (folder / "page.js").read_text(), (folder / "page.css").read_text()
    at = html.index("<head>") + len("<head>")
    additions = f"<script>{script}</script><style>{style}</style>"
    return f"{html[:at]}{additions}{html[at:]}".encode()


class Gate:
    """Checks every request, serves the page, and reads the drive channel."""

    def __init__(
        self,
        is_loopback: bool,
        token: Optional[str],
        on_message: Callable[[int, Message], None],
        on_leave: Callable[[int], None],
    ) -> None:
        """Args as `refusal`; the callbacks get a number that tells the pages apart."""
        self._is_loopback, self._token, self._page = is_loopback, token, page()
        self._on_message, self._on_leave = on_message, on_leave

    def guards(self) -> ContextManager[None]:
        """A server of viser's that is started meanwhile stands behind this gate."""
        return started_behind(self._answer, self._with_drive_channel)

    def _answer(self, _connection: Any, request: Request) -> Optional[Response]:
        """An HTTP response, or None for a WebSocket that may be opened."""
        reason = refusal(request.headers, request.path, self._is_loopback, self._token)
        if reason is not None:
            return _response(http.HTTPStatus.FORBIDDEN, reason.encode(), "text/plain; charset=utf-8")
        if request.headers.get("Upgrade", "").lower() == "websocket":
            return None
        if urlsplit(request.path).path not in ("/", "/index.html"):
            return _response(http.HTTPStatus.NOT_FOUND, b"there is only /", "text/plain; charset=utf-8")
        response = _response(http.HTTPStatus.OK, self._page, "text/html; charset=utf-8")
        if self._token is not None:
            response.headers["Set-Cookie"] = f"{COOKIE}={self._token}; HttpOnly; SameSite=Strict; Path=/"
        return response

    def _with_drive_channel(self, handler: Any) -> Any:
        async def handle(connection: Any) -> None:
            if urlsplit(connection.request.path).path == DRIVE_PATH:
                await self._read_drive_channel(connection)
            else:
                await handler(connection)

        return handle

    async def _read_drive_channel(self, connection: Any) -> None:
        try:
            async for text in connection:
                message = _parse(text)
                if message is not None:
                    self._on_message(id(connection), message)
        except ConnectionClosed:
            pass
        finally:
            self._on_leave(id(connection))


def _parse(text: Any) -> Optional[Message]:
    if len(text) > MAX_MESSAGE:
        return None
    try:
        message = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return message if isinstance(message, dict) else None


def _response(status: http.HTTPStatus, body: bytes, kind: str) -> Response:
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
