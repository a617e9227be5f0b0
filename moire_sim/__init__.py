"""A virtual fringe-projection head."""
