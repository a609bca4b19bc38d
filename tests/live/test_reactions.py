"""What is sent at events, to real servers: that one hangs or refuses is told, and stops nothing."""

from __future__ import annotations

import signal
import time
from datetime import UTC, datetime
from pathlib import Path

import pytest

from actioncli.errors import UsageError
from actioncli.live import mqtt, reactions
from actioncli.live.events import Event
from actioncli.live.mqtt import Mqtt
from actioncli.live.reactions import Reaction, Webhook

from .servers import broker, free_port, hook, subscribed, until

WAVE = Event("wave", 1.0, 2.5, 0.75)


def quickly(react: Reaction, event: Event = WAVE) -> None:
    """Do it, which makes nobody wait."""
    begun = time.monotonic()
    react(event)
    assert time.monotonic() - begun < 0.2


def check_document(document: dict[str, object]) -> None:
    told = datetime.fromisoformat(str(document.pop("time")))
    assert abs((datetime.now(UTC) - told).total_seconds()) < 60
    assert document == WAVE.to_json()


def test_a_webhook_posts_json() -> None:
    told: list[str] = []
    with hook() as server:
        react = Webhook(f"http://me:se%20cret@127.0.0.1:{server.port}/a?b=c", told.append)
        quickly(react)
        react.close()
        (path, document), [headers] = server.posted[0], server.headers
    assert path == "/a?b=c"
    check_document(document)
    assert headers["Content-Type"] == "application/json"
    assert headers["Authorization"] == "Basic bWU6c2UgY3JldA=="
    assert told == []


def test_a_webhook_that_refuses_is_told_once_and_when_it_is_back() -> None:
    told: list[str] = []
    port = free_port()
    react = Webhook(f"http://127.0.0.1:{port}/secret", told.append)
    name = f"--webhook http://127.0.0.1:{port}"
    for _ in range(3):
        quickly(react)
    until(lambda: react._waiting.empty() and told)
    time.sleep(0.2)
    assert told == [
        f"error: {name}: [Errno 111] Connection refused; events are dropped until it works."
    ]
    with hook(port) as server:
        server.status = 500
        quickly(react)
        until(lambda: server.posted)
        server.status = 200
        quickly(react)
        until(lambda: len(told) > 1)
    assert told[1:] == [f"note: {name}: works again; events dropped: 4."]
    react.close()


def test_a_webhook_that_hangs_is_told_and_nothing_is_sent_late(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(reactions, "LATE", 1.0)
    told: list[str] = []
    with hook() as server:
        server.status = None
        react = Webhook(f"http://127.0.0.1:{server.port}/", told.append)
        for _ in range(40):
            quickly(react)
        until(lambda: react._waiting.empty())
        server.status = 200
        quickly(react)
        until(lambda: len(told) == 2)
        react.close()
        assert len(server.posted) == 2
    first, second = told
    assert "; events are dropped until it works." in first
    assert second.endswith(": works again; events dropped: 40.")


def test_a_webhook_that_hangs_lets_watching_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reactions, "LAST_SECONDS", 0.3)
    with hook() as server:
        server.status = None
        react = Webhook(f"http://127.0.0.1:{server.port}/", print)
        for _ in range(40):
            react(WAVE)
        begun = time.monotonic()
        react.close()
        assert time.monotonic() - begun < 2


def test_only_the_address_that_was_given_is_contacted() -> None:
    told: list[str] = []
    with hook() as server:
        server.status = 302
        react = Webhook(f"http://127.0.0.1:{server.port}/given", told.append)
        react(WAVE)
        react.close()
        assert [path for path, _ in server.posted] == ["/given"]
    assert "answers 302" in told[0]


amqtt = pytest.mark.usefixtures("brokers")


@pytest.fixture
def brokers() -> None:
    pytest.importorskip("paho.mqtt", reason="needs the extra mqtt")
    pytest.importorskip("amqtt", reason="needs the extra dev")


@amqtt
def test_events_reach_a_subscriber_and_actions_are_sensors() -> None:
    told: list[str] = []
    port = free_port()
    with broker(port), subscribed(port) as got:
        react = Mqtt(f"mqtt://127.0.0.1:{port}/home/hall/", told.append)
        react.enrolled(["wave", "a/b+c#d%"])
        until(lambda: len(got) == 3)
        assert ("home/hall/status", "online") in got
        sensors = {
            document["name"]: (topic, document) for topic, document in got if "name" in document
        }
        assert set(sensors) == {"wave", "a/b+c#d%"}
        topic, sensor = sensors["wave"]
        assert topic.startswith("homeassistant/sensor/actioncli_")
        assert topic.endswith("/config")
        assert sensor["state_topic"] == sensor["json_attributes_topic"] == "home/hall/action/wave"
        assert sensor["availability_topic"] == "home/hall/status"
        assert sensors["a/b+c#d%"][1]["state_topic"] == "home/hall/action/a%2Fb%2Bc%23d%25"
        assert sensor["device"] == sensors["a/b+c#d%"][1]["device"]
        got.clear()

        quickly(react)
        until(lambda: got)
        [(topic, document)] = got
        assert topic == sensor["state_topic"]
        check_document(document)
        got.clear()

        react.enrolled(["wave"])  # the other one was removed meanwhile
        until(lambda: (sensors["a/b+c#d%"][0], "") in got)
        got.clear()
        react.close()
        until(lambda: ("home/hall/status", "offline") in got)

        # Another run, in which another action is enrolled: what the broker kept goes.
        again = Mqtt(f"mqtt://127.0.0.1:{port}/home/hall", told.append)
        again.enrolled(["squat"])
        until(lambda: (sensors["wave"][0], "") in got)
        again.close()
    with broker(port), subscribed(port) as got:
        time.sleep(0.5)
        assert got == []
    assert told == []


@amqtt
def test_a_broker_that_is_refused_hangs_and_comes_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mqtt, "LATE", 2.0)
    told: list[str] = []
    port = free_port()
    react = Mqtt(f"mqtt://me:secret@127.0.0.1:{port}/x", told.append)
    react.enrolled(["wave"])
    quickly(react)
    until(lambda: told)
    quickly(react)
    with broker(port) as process, subscribed(port) as got:
        until(lambda: len(told) == 2)
        quickly(react)
        until(lambda: any(topic == "x/action/wave" for topic, _ in got))
        process.send_signal(signal.SIGSTOP)
        until(lambda: len(told) == 3)
        quickly(react)
        process.send_signal(signal.SIGCONT)
        until(lambda: len(told) == 4)
        process.send_signal(signal.SIGSTOP)
        begun = time.monotonic()
        react.close()
        assert time.monotonic() - begun < 10
    refused, back, hangs, again = told[:4]
    assert refused.startswith(f"error: --mqtt 127.0.0.1:{port}: ")
    assert back == f"note: --mqtt 127.0.0.1:{port}: works again; events dropped: 2."
    assert "the connection is lost" in hangs
    assert again.endswith("works again; events dropped: 1.")


@amqtt
def test_who_is_not_let_in_is_told(tmp_path: Path) -> None:
    from pwdlib import PasswordHash
    from pwdlib.hashers.argon2 import Argon2Hasher

    users = tmp_path / "users"
    users.write_text(f"me:{PasswordHash((Argon2Hasher(),)).hash('se/cret')}\n")
    refused: list[str] = []
    welcome: list[str] = []
    port = free_port()
    with broker(port, str(users)):
        stranger = Mqtt(f"mqtt://me:wrong@127.0.0.1:{port}/x", refused.append)
        until(lambda: refused)
        known = Mqtt(f"mqtt://me:se%2Fcret@127.0.0.1:{port}/x", welcome.append)
        until(known._client.is_connected)
        stranger.close()
        known.close()
    [line] = refused
    assert "wrong" not in line
    assert "; events are dropped until it works." in line
    assert welcome == []


@pytest.mark.parametrize(
    ("kind", "address"),
    [
        *[(Webhook, text) for text in ("ftp://a/b", "http://", "http://a:b/", "http://[a/")],
        *[(Mqtt, text) for text in ("http://a/b", "mqtt://a", "mqtt://a/", "mqtt://a/+/b")],
        *[(kind, text) for kind in (Webhook, Mqtt) for text in ("", "localhost", "mqtt://a/%23")],
    ],
)
def test_what_is_no_address(kind: type[Webhook | Mqtt], address: str) -> None:
    with pytest.raises(UsageError, match=f"--{kind.__name__.lower()}: th(at|e address)"):
        kind(address, print)
