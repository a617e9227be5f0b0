"""Set-up and demo scripts; not installed."""
