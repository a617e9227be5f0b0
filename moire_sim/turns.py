"""When a head that takes turns with others exposes: at a fixed share of each period of the common clock."""

from __future__ import annotations

NANOSECONDS = 1_000_000_000


def seconds_to_turn(now_ns: int, rate_hz: float, share: float) -> float:
    """Return the time until the next exposure, in seconds, more than 0 and at most one period.

    Exposures lie ``share`` (0 to 1) of a period after whole multiples of it, so heads of the same rate and clock whose
    shares differ never light a scene at once, and need not know of each other.
    """
    period_ns = round(NANOSECONDS / rate_hz)
    return (period_ns - (now_ns - round(share * period_ns)) % period_ns) / NANOSECONDS
