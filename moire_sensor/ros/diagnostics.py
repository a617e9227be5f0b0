"""Building blocks of ``/diagnostics``: one status per concern, named ``node: concern``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from moire_sensor.ros.qos import destroy_publisher, overridable, publisher_maker, publisher_qos

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class DiagnosticsPublisher:
    """Publish statuses of one node; the hardware id is its full name, which tells two heads apart."""

    def __init__(self, node: Any) -> None:
        self._node = node
        self._publisher = publisher_maker(node)(
            DiagnosticArray, "/diagnostics", publisher_qos(), qos_overriding_options=overridable()
        )

    def close(self) -> None:
        """Give the publisher back."""
        destroy_publisher(self._node, self._publisher)

    def publish(self, statuses: list[DiagnosticStatus]) -> None:
        """Stamp and send the statuses; adds node name and hardware id."""
        for status in statuses:
            status.name = f"{self._node.get_name()}: {status.name}"
            status.hardware_id = self._node.get_fully_qualified_name()
        message = DiagnosticArray(status=statuses)
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)


def status_of(concern: str, level: bytes, message: str, values: Mapping[str, Any]) -> DiagnosticStatus:
    """Return one status; values are written as text, floats with six significant digits."""
    pairs = [KeyValue(key=key, value=_text(value)) for key, value in values.items()]
    return DiagnosticStatus(name=concern, level=level, message=message, values=pairs)


def _text(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
