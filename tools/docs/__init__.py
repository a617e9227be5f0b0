"""The documentation site: its generated pages and pictures."""
