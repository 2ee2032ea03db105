"""Requests that the page answers, and messages of a browser that it reads."""

import pytest

from husky_web.page_server import _parse, address_to_open, refusal


def test_junk_on_the_drive_channel_is_no_message():
    assert _parse("[" * 999) is None
    assert _parse('{"linear": NaN}') == {"linear": pytest.approx(float("nan"), nan_ok=True)}


HERE = {"Host": "127.0.0.1:8080"}


@pytest.mark.parametrize(
    ("headers", "path", "is_loopback", "token", "words"),
    [
        (HERE, "/", True, None, None),
        ({"Host": "localhost:9000", "Origin": "http://localhost:9000"}, "/drive", True, None, None),
        ({"Host": "evil.example:8080"}, "/", True, None, "evil.example"),  # a name that points here by DNS
        ({**HERE, "Origin": "http://evil.example"}, "/drive", True, None, "another site"),
        ({**HERE, "Origin": "null"}, "/", True, None, "another site"),
        ({"Host": "10.0.0.5:8080"}, "/", False, "s3cret", "token"),
        ({"Host": "10.0.0.5:8080"}, "/?token=wrong", False, "s3cret", "token"),
        ({"Host": "10.0.0.5:8080"}, "/?token=s3cret", False, "s3cret", None),
        ({"Host": "10.0.0.5:8080", "Cookie": "husky_token=s3cret"}, "/drive", False, "s3cret", None),
        ({"Host": "10.0.0.5:8080", "Cookie": "husky_token=s3cre"}, "/drive", False, "s3cret", "token"),
    ],
)
def test_who_may_come_in(headers, path, is_loopback, token, words):
    reason = refusal(headers, path, is_loopback, token)
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
