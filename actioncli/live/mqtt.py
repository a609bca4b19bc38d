"""Events for a home: sent to an MQTT broker, where each action appears as a sensor."""

from __future__ import annotations

import contextlib
import hashlib
import re
from collections.abc import Callable, Collection
from typing import Any
from urllib.parse import unquote

from actioncli._version import __version__
from actioncli.errors import UsageError
from actioncli.files import json_text
from actioncli.live.events import Event
from actioncli.live.reactions import LAST_SECONDS, LATE, Line, Reaction, event_text, split_address

# Where Home Assistant looks for sensors.
_DISCOVERY = "homeassistant/sensor"


class Mqtt(Reaction):
    """Publishes events below a topic: `TOPIC/action/LABEL` as JSON, and `TOPIC/status`.

    Each action is described to Home Assistant as a sensor whose state is when it was last
    performed, and whose attributes are the event's fields.
    """

    def __init__(self, address: str, note: Callable[[str], None]) -> None:
        """Begin to connect, in a thread of its own, and whenever the connection is lost.

        Args:
            address: mqtt://[user:password@]host[:port]/topic, or mqtts:// for TLS.

        Raises:
            UsageError: the address is none, or the package for it is not installed.
        """
        parts, port = split_address("--mqtt", address, ("mqtt", "mqtts"))
        self._topic = unquote(parts.path).strip("/")
        if not self._topic or re.search(r"[+#\0]", self._topic):
            raise UsageError("--mqtt: the address ends in a topic without + and #: /home/gestures.")
        try:
            from paho.mqtt.client import Client
            from paho.mqtt.enums import CallbackAPIVersion
        except ImportError as error:
            raise UsageError("--mqtt needs paho-mqtt: pip install 'actioncli[mqtt]'.") from error
        secure = parts.scheme == "mqtts"
        port = port or (8883 if secure else 1883)
        self._line = Line(f"--mqtt {parts.hostname}:{port}", note)
        self._node = f"actioncli_{_short(self._topic)}"
        self._labels: frozenset[str] = frozenset()
        self._client = Client(CallbackAPIVersion.VERSION2)
        if parts.username is not None:
            self._client.username_pw_set(unquote(parts.username), unquote(parts.password or ""))
        if secure:
            self._client.tls_set()
        self._client.will_set(f"{self._topic}/status", "offline", qos=1, retain=True)
        self._client.on_connect = self._on_connect
        self._client.on_connect_fail = lambda *_: self._line.fails("cannot be reached")
        self._client.on_disconnect = self._on_disconnect
        self._client.on_message = self._on_message
        self._client.connect_timeout = LATE
        self._client.reconnect_delay_set(1, 30)
        # A broker that hangs is noticed after this time.
        self._client.connect_async(str(parts.hostname), port, keepalive=round(LATE))
        self._client.loop_start()

    def enrolled(self, labels: Collection[str]) -> None:
        """Describe these actions; sensors of others go."""
        gone, self._labels = self._labels - set(labels), frozenset(labels)
        if self._client.is_connected():
            self._describe()
            for label in gone:
                self._client.publish(self._sensor(label), b"", qos=1, retain=True)

    def __call__(self, event: Event) -> None:
        """Publish it at once, or not at all."""
        if not self._client.is_connected():
            self._line.fails("is not connected", 1)
            return
        self._client.publish(self._state(event.label), event_text(event))

    def close(self) -> None:
        """Tell that nobody watches any more."""
        if self._client.is_connected():
            sent = self._client.publish(f"{self._topic}/status", "offline", qos=1, retain=True)
            with contextlib.suppress(RuntimeError, ValueError):  # it was lost meanwhile
                sent.wait_for_publish(LAST_SECONDS)
        # Its thread ends by itself; one that hangs is not waited for.
        self._client.disconnect()

    def _describe(self) -> None:
        self._client.publish(f"{self._topic}/status", "online", qos=1, retain=True)
        for label in sorted(self._labels):
            described = {
                "name": label,
                "unique_id": f"{self._node}_{_short(label)}",
                "device_class": "timestamp",
                "state_topic": self._state(label),
                "value_template": "{{ value_json.time }}",
                "json_attributes_topic": self._state(label),
                "availability_topic": f"{self._topic}/status",
                "device": {"identifiers": [self._node], "name": f"actioncli {self._topic}"},
                "origin": {"name": "actioncli", "sw_version": __version__},
            }
            text = json_text(described, indent=None)
            self._client.publish(self._sensor(label), text, qos=1, retain=True)

    def _state(self, label: str) -> str:
        # What would be levels or wildcards of a topic is written as in addresses.
        safe = re.sub(r"[/+#%]", lambda found: f"%{ord(found[0]):02X}", label)
        return f"{self._topic}/action/{safe}"

    def _sensor(self, label: str) -> str:
        return f"{_DISCOVERY}/{self._node}/{_short(label)}/config"

    def _on_connect(self, client: Any, _: Any, flags: Any, reason: Any, properties: Any) -> None:
        if reason.is_failure:
            self._line.fails(reason)
            return
        self._line.works()
        # The broker keeps what an earlier run described.
        client.subscribe(f"{_DISCOVERY}/{self._node}/+/config")
        self._describe()

    def _on_disconnect(self, client: Any, _: Any, flags: Any, reason: Any, properties: Any) -> None:
        if reason.is_failure:
            self._line.fails(f"the connection is lost ({reason})")

    def _on_message(self, client: Any, _: Any, message: Any) -> None:
        """The description of an action that is not enrolled any more goes."""
        known = {self._sensor(label) for label in self._labels}
        if message.payload and message.topic not in known:
            client.publish(message.topic, b"", qos=1, retain=True)


def _short(text: str) -> str:
    """A name that every topic may hold."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]
