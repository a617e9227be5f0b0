"""What the virtual head says of its exposures on ``/diagnostics``."""

from __future__ import annotations

from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from moire_sensor.ros.diagnostics import OK, WARN, status_of


def exposure_status(
    parameters: dict[str, Any], exposures: int, laser_on: bool, reached_hz: float, is_slow: bool
) -> DiagnosticStatus:
    """Return the status of the exposures: how many, of what, and whether as often as ``rate_hz`` asks for."""
    values = {"exposures": exposures, "laser on": laser_on, "reached Hz": reached_hz}
    values |= {name: parameters[name] for name in ("scene", "rate_hz", "seed", "phase_steps", "optics")}
    if is_slow:
        text = (
            f"{reached_hz:.3g} of {parameters['rate_hz']:g} Hz reached: this machine cannot do more; lower rate_hz, or "
            "try renderer:=auto, optics:=clean or a scene where nothing moves"
        )
        return status_of("exposure", WARN, text, values)
    if not laser_on:
        return status_of("exposure", WARN, "the projector is off", values)
    return status_of("exposure", OK, "exposing", values)
