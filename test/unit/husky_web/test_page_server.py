"""Requests that the page answers, and messages of a browser that it reads."""

import socket

import pytest
import rospkg
import rospy

from husky_highlevel_controller.datatypes import HuskyError
from husky_web.page_server import (
    LOOPBACK,
    MAX_PORT,
    TOKEN_FILE,
    _find_free_port,
    _kept_token,
    _parse,
    address_to_open,
    refusal,
)


def test_junk_on_the_drive_channel_is_no_message():
    assert _parse("[" * 999) is None
    assert _parse('{"linear": NaN}') == {"linear": pytest.approx(float("nan"), nan_ok=True)}


HERE = {"Host": "127.0.0.1:8080"}


@pytest.mark.parametrize(
    ("headers", "path", "hosts", "token", "words"),
    [
        (HERE, "/", LOOPBACK, None, None),
        ({"Host": "localhost:9000", "Origin": "http://localhost:9000"}, "/drive", LOOPBACK, None, None),
        (
            {"Host": "evil.example:8080"},
            "/",
            LOOPBACK,
            None,
            "evil.example",
        ),  # a name that points here by DNS
        ({**HERE, "Origin": "http://evil.example"}, "/drive", LOOPBACK, None, "another site"),
        ({"Host": "vm:8080"}, "/", LOOPBACK, None, "vm:8080"),
        ({"Host": "VM:8080"}, "/", (*LOOPBACK, "vm"), None, None),  # address:=vm, a name of this machine
        ({**HERE, "Origin": "null"}, "/", LOOPBACK, None, "another site"),
        ({"Host": "10.0.0.5:8080"}, "/", None, "s3cret", "token"),
        ({"Host": "10.0.0.5:8080"}, "/?token=wrong", None, "s3cret", "token"),
        ({"Host": "10.0.0.5:8080"}, "/?token=s3cret", None, "s3cret", None),
        ({"Host": "10.0.0.5:8080", "Cookie": "husky_token=s3cret"}, "/drive", None, "s3cret", None),
        ({"Host": "10.0.0.5:8080", "Cookie": "husky_token=s3cre"}, "/drive", None, "s3cret", "token"),
    ],
)
def test_who_may_come_in(headers, path, hosts, token, words):
    reason = refusal(headers, path, hosts, token)
    assert (reason is None) if words is None else (words in reason)


@pytest.mark.parametrize(
    ("host", "address"),
    [
        ("localhost", "http://localhost:80"),
        ("fe80::1", "http://[fe80::1]:80"),
        ("0.0.0.0", "http://127.0.0.1:80 (from another machine: http://"),
        # asyncio binds :: to IPv6 only, so 127.0.0.1 would refuse the connection
        ("::", "http://[::1]:80 (from another machine: http://"),
    ],
)
def test_the_printed_address_can_be_opened(host, address):
    assert address_to_open(host, ":80").startswith(address)


def test_a_port_in_use_is_followed_by_the_next_free_one_and_the_last_one_by_an_error():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", MAX_PORT - 1))
        taken.listen()
        assert _find_free_port("127.0.0.1", MAX_PORT - 1) == MAX_PORT
        with socket.socket() as last:
            last.bind(("127.0.0.1", MAX_PORT))
            last.listen()
            with pytest.raises(HuskyError, match=f"port = {MAX_PORT - 1}.*in use"):
                _find_free_port("127.0.0.1", MAX_PORT - 1)


def test_the_token_is_the_same_after_a_restart_and_only_the_user_can_read_it(monkeypatch, tmp_path):
    monkeypatch.setattr(rospkg, "get_ros_home", lambda: str(tmp_path / "home"))
    token = _kept_token()
    assert len(token) > 16
    assert _kept_token() == token
    assert (tmp_path / "home" / TOKEN_FILE).stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize("content", [b"", b"short", b"\xff" * 30])
def test_a_token_that_can_be_guessed_is_not_used(monkeypatch, tmp_path, content):
    warnings = []
    monkeypatch.setattr(rospkg, "get_ros_home", lambda: str(tmp_path))
    monkeypatch.setattr(rospy, "logwarn", warnings.append)
    (tmp_path / TOKEN_FILE).write_bytes(content)
    assert _kept_token() != _kept_token()
    assert all(TOKEN_FILE in warning for warning in warnings)
    assert len(warnings) == 2
