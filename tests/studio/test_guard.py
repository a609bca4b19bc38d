"""Who may talk to a local page."""

import resource
import socket
from collections.abc import Iterator
from contextlib import ExitStack

import pytest
from cases import cases
from hypothesis import given, settings
from hypothesis import strategies as st
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

from actioncli.studio import server

from .serving import Client, until


@pytest.mark.parametrize("path", ["/", "/static/studio.js", "/static/page.css"])
def test_the_files_of_the_page_need_no_token_and_hold_nothing(client: Client, path: str) -> None:
    status, headers, content = client.answer("GET", path, headers={})
    assert status == 200
    assert client.token.encode() not in content
    assert "Set-Cookie" not in headers


@pytest.mark.parametrize("path", ["/api/state", "/api/export", "/nothing", "/static"])
def test_nothing_is_told_without_the_token(client: Client, path: str) -> None:
    for headers in (
        {},
        {"Authorization": "Bearer guess"},
        {"Authorization": "Bearer "},
        {"Cookie": f"token={client.token}; actioncli-{client.port}={client.token}"},
    ):
        for address in (path, f"{path}?token={client.token}"):
            status, answered, content = client.answer("GET", address, headers=headers)
            assert status == 403
            assert content.startswith(b"Refused: open the whole address")
            assert client.token.encode() not in content
            assert "Set-Cookie" not in answered


@pytest.mark.parametrize("method", ["POST", "DELETE", "PUT", "PATCH"])
def test_what_changes_something_comes_from_the_page_itself(client: Client, method: str) -> None:
    origin = client.headers["Origin"]
    for foreign in (None, "null", "http://evil.example", origin + "0", "http://127.0.0.1:1"):
        headers = {"Authorization": client.headers["Authorization"]}
        if foreign is not None:
            headers["Origin"] = foreign
        status, _, content = client.answer(method, "/api/actions", b"{}", headers)
        assert status == 403
        assert b"only the page itself" in content


@pytest.mark.parametrize(
    "host", ["evil.example", "127.0.0.1", "localhost:1", "127.0.0.1.nip.io", ""]
)
def test_a_name_that_was_pointed_here_is_refused(client: Client, host: str) -> None:
    headers = {**client.headers, "Host": host}
    status, _, content = client.answer("GET", "/api/state", headers=headers)
    assert status in {400, 403}
    assert b"store" not in content


def test_a_page_may_also_call_it_localhost(client: Client) -> None:
    host = f"localhost:{client.port}"
    headers = {**client.headers, "Host": host, "Origin": f"http://{host}"}
    assert client.answer("GET", "/api/state", headers=headers)[0] == 200
    assert client.answer("PUT", "/api/tau", b'{"tau": null}', headers)[0] == 200


@pytest.mark.parametrize(
    ("offered", "origin"),
    [
        ([], "http://127.0.0.1:PORT"),
        (["actioncli", "guess"], "http://127.0.0.1:PORT"),
        (["actioncli", "TOKEN"], None),
        (["actioncli", "TOKEN"], "http://127.0.0.1:1"),
    ],
)
def test_a_websocket_needs_both(client: Client, offered: list[str], origin: str | None) -> None:
    subprotocols = [Subprotocol(each.replace("TOKEN", client.token)) for each in offered]
    sent = None if origin is None else Origin(origin.replace("PORT", str(client.port)))
    # Its address and headers alone open nothing.
    address = f"ws://127.0.0.1:{client.port}/api/live?token={client.token}"
    token = {"Authorization": f"Bearer {client.token}"}
    with (
        pytest.raises(InvalidStatus) as refused,
        connect(address, origin=sent, subprotocols=subprotocols or None, additional_headers=token),
    ):
        pass
    assert refused.value.response.status_code == 403


@pytest.mark.parametrize("path", ["/", "/api/state", "/static/studio.js", "/static/none", "/none"])
def test_every_answer_keeps_others_out(client: Client, path: str) -> None:
    _, headers, _ = client.answer("GET", path)
    policy = headers["Content-Security-Policy"]
    assert policy.startswith("default-src 'none'")
    assert "unsafe" not in policy
    assert "*" not in policy
    assert headers["Cache-Control"] == "no-store"
    assert headers["Referrer-Policy"] == "no-referrer"
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Cross-Origin-Resource-Policy"] == "same-origin"
    assert "Access-Control-Allow-Origin" not in headers


@pytest.mark.parametrize(
    "path", ["/static/../app.py", "/static/%2e%2e%2fapp.py", "/static/studio.html", "/static/"]
)
def test_only_the_pages_files_are_served(client: Client, path: str) -> None:
    assert client.answer("GET", path)[0] == 404


@settings(max_examples=cases(25), deadline=None)
@given(given_=st.text(st.characters(min_codepoint=32, max_codepoint=255), max_size=60))
def test_nothing_else_is_taken_for_the_token(served: tuple[object, str], given_: str) -> None:
    client = Client(served[1])
    header = f"Bearer {given_}".encode().decode("latin-1").strip()
    assert client.answer("GET", "/api/state", headers={"Authorization": header})[0] in {400, 403}


@pytest.fixture
def many_files() -> Iterator[None]:
    """Room for both ends of many connections in one process."""
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    if 0 <= before[1] < 2048:
        pytest.skip("needs 2,048 open files")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(before[0], 2048), before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_NOFILE, before)


@pytest.mark.usefixtures("many_files")
def test_who_connects_and_asks_nothing_keeps_nobody_out(
    client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, "_FIRST_SECONDS", 600.0)
    with ExitStack() as stack:
        idle = [
            stack.enter_context(socket.create_connection(("127.0.0.1", client.port), 30))
            for _ in range(1100)
        ]
        assert client.answer("GET", "/api/state")[0] == 200
        until(lambda: sum(map(is_open, idle)) <= server.MOST_IDLE)
        # The newest stay: who asks at once is among them.
        assert is_open(idle[-1])


def test_a_first_request_has_to_come_soon_and_whole(
    client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, "_FIRST_SECONDS", 0.3)
    for begun in (b"", b"GET /api/state HTTP/1.1\r\nHost: "):
        with socket.create_connection(("127.0.0.1", client.port), 30) as connection:
            connection.sendall(begun)
            until(lambda: not is_open(connection), 10)


def is_open(connection: socket.socket) -> bool:
    """Whether the other end has not closed it; nothing was sent to it."""
    connection.setblocking(False)
    try:
        return bool(connection.recv(1))
    except BlockingIOError:
        return True
    except ConnectionError:
        return False
