"""Errors that say what came, what is allowed and what to do."""

from __future__ import annotations


class MoireError(Exception):
    """Root of every error this project raises on purpose."""


class RigError(MoireError):
    """Projection matrices, camera infos or image sizes that do not describe a usable rig."""


class PatternError(MoireError):
    """A fringe pattern that cannot be projected or decoded."""


class ImageError(MoireError):
    """Images of a wrong shape, type or number."""


class SettingsError(MoireError):
    """A parameter outside its allowed range, or an unknown choice."""


class CaptureError(MoireError):
    """A capture folder that is missing, incomplete or malformed."""


def quoted(text: str, most: int = 60) -> str:
    """Return a text that came from outside in quotes, cut to ``most`` characters, for use in a message."""
    return repr(text if len(text) <= most else text[:most] + "...")
