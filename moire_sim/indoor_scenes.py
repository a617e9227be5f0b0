"""Indoor scenes for navigation: what a robot's costmap must show. The floor lies below the head by the constants."""

from __future__ import annotations

from moire_sim.meshes import Body, box

# Heights of the left camera over the floor, metres.
CORRIDOR_HEIGHT_M, DOORWAY_HEIGHT_M, TABLE_HEIGHT_M = 0.35, 0.5, 0.8
DARK, BRIGHT = 0.6, 0.9


def floor(height_m: float) -> Body:
    """Floor ``height_m`` below the head, from 0.3 to 4.5 m ahead."""
    return box((0.0, height_m + 0.05, 2.4), (4.0, 0.1, 4.2), DARK)


def corridor_with_boxes(boxes: float) -> tuple[Body, ...]:
    """A corridor 0.94 m wide with up to two boxes on its floor; its end lies far beyond the sensor's range."""
    walls = tuple(box((side * 0.52, -0.3, 2.4), (0.1, 1.4, 4.2), BRIGHT) for side in (-1.0, 1.0))
    low = box((-0.12, CORRIDOR_HEIGHT_M - 0.11, 1.15), (0.22, 0.22, 0.20), BRIGHT, 0.2)
    high = box((0.17, CORRIDOR_HEIGHT_M - 0.15, 1.55), (0.18, 0.30, 0.20), BRIGHT, -0.35)
    end = box((0.0, -0.3, 4.4), (0.94, 1.4, 0.1), BRIGHT)
    return floor(CORRIDOR_HEIGHT_M), *walls, end, *(low, high)[: round(boxes)]


def doorway(bin_m: float) -> tuple[Body, ...]:
    """A doorway 0.72 m wide in a wall at 1.72 m, a room behind it, and a bin ``bin_m`` high in it, 0 for none."""
    middle = (DOORWAY_HEIGHT_M - 1.5) / 2.0
    wall = tuple(box((side * 0.96, middle, 1.78), (1.2, DOORWAY_HEIGHT_M + 1.5, 0.12), BRIGHT) for side in (-1.0, 1.0))
    back = box((0.0, middle, 3.6), (4.0, DOORWAY_HEIGHT_M + 1.5, 0.1), BRIGHT)
    bin_body = (box((0.1, DOORWAY_HEIGHT_M - bin_m / 2.0, 1.45), (0.2, bin_m, 0.2), BRIGHT, 0.4),) if bin_m else ()
    return floor(DOORWAY_HEIGHT_M), *wall, back, *bin_body


def table_edge(distance_m: float) -> tuple[Body, ...]:
    """A table whose edge, 25 mm thick, begins at a distance; two thin legs, open space below and behind."""
    top_m = TABLE_HEIGHT_M - 0.45
    top = box((0.05, top_m + 0.0125, distance_m + 0.30), (0.55, 0.025, 0.60), BRIGHT)
    legs = tuple(
        box((x, (top_m + 0.025 + TABLE_HEIGHT_M) / 2.0, distance_m + 0.06), (0.04, 0.425, 0.04), BRIGHT)
        for x in (-0.18, 0.28)
    )
    return floor(TABLE_HEIGHT_M), top, *legs
