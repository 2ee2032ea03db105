"""viser's server behind the gate, bound where it was asked to be."""

from __future__ import annotations

import contextlib
import io
import ipaddress
import secrets
import socket
import warnings
from typing import Any, Callable, Dict, NamedTuple, Optional

import rospy
import viser

from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.ros.web.gate import Gate


class PageServer(viser.ViserServer):
    """viser without the offer to show the page through a host of viser's makers."""

    def request_share_url(self, verbose: bool = True) -> Optional[str]:
        """Refused, whichever page asks for it."""
        rospy.logwarn("a page asked to be shared through another host; refused")
        return None


class Served(NamedTuple):
    """A running server, and the address to open."""

    server: PageServer
    address: str
    has_token: bool  # in the address


def serve(
    host: str, port: int, on_message: Callable[[int, Dict[str, Any]], None], on_leave: Callable[[int], None]
) -> Served:
    """Start the server; where the port is taken, the next free one is used.

    Args:
        host: an address of this machine; any but a loopback address gets a random token.
        port: 1..65535.
        on_message: gets each message of the drive channel, with a number for the page.
        on_leave: called when a page is gone.

    Raises:
        HuskyError: this machine has no such address.
    """
    is_loopback = _is_loopback(host)
    token = None if is_loopback else secrets.token_urlsafe(16)
    warnings.filterwarnings("ignore", "Queued a .* on a closed connection")  # a page may leave at any moment
    gate = Gate(is_loopback, token, on_message, on_leave)
    with gate.guards(), contextlib.redirect_stdout(io.StringIO()):  # viser prints a table of its own
        server = PageServer(host=host, port=port, label="Husky", verbose=False)
    everywhere = host in ("0.0.0.0", "::")
    visible_host = "127.0.0.1" if everywhere else f"[{host}]" if ":" in host else host
    suffix = f":{server.get_port()}" + ("" if token is None else f"/?token={token}")
    # no other machine knows a container's host name; its published port is this machine's
    elsewhere = f" (from another machine: http://{socket.gethostname()}{suffix})" if everywhere else ""
    return Served(server, f"http://{visible_host}{suffix}{elsewhere}", token is not None)


def _is_loopback(host: str) -> bool:
    try:
        family, _, _, _, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.bind(address)
    except OSError as error:
        raise HuskyError(
            f"{rospy.get_name()}/address = '{host}' is no address of this machine: {error}"
        ) from None
    return ipaddress.ip_address(address[0]).is_loopback
