"""Figure 8: the rig to scale, both fields of view and the lit volume."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from moire_sensor.paper_rig import (
    CX_PX,
    FX_PX,
    IMAGE_SIZE,
    PERIOD_PX,
    PROJECTOR_CX_PX,
    PROJECTOR_SIZE,
    PROJECTOR_X_M,
    REFERENCE_DEPTH_M,
    RIGHT_X_M,
)
from tools.bench.tables import Table, number
from tools.figures.drawing import BLUE, GREEN, GREY, ORANGE
from tools.figures.page import Claim, Experiment
from tools.figures.stage import Array
from tools.small_png import save

DEPTHS_M = (0.5, 0.6, 1.0, 1.5)


@dataclass(frozen=True)
class Device:
    """A device of the rig in plan: all look along z."""

    name: str
    x_m: float
    centre_px: float
    columns: int
    colour: str

    def x_at(self, column_px: float, depth_m: float | Array) -> Array:
        """Where a column's ray is at a depth, metres from the left camera."""
        return np.asarray(self.x_m + (column_px - self.centre_px) / FX_PX * np.asarray(depth_m))

    def borders_m(self, depth_m: float | Array) -> tuple[Array, Array]:
        """Left and right border of the field at a depth."""
        return self.x_at(-0.5, depth_m), self.x_at(self.columns - 0.5, depth_m)

    @property
    def angle_deg(self) -> float:
        """Opening angle across."""
        sides = (self.centre_px + 0.5, self.columns - 0.5 - self.centre_px)
        return math.degrees(sum(math.atan(side / FX_PX) for side in sides))


LEFT = Device("left camera", 0.0, CX_PX, IMAGE_SIZE[0], BLUE)
RIGHT = Device("right camera", RIGHT_X_M, CX_PX, IMAGE_SIZE[0], ORANGE)
PROJECTOR = Device("projector", PROJECTOR_X_M, PROJECTOR_CX_PX, PROJECTOR_SIZE[0], GREEN)


@dataclass(frozen=True)
class Plan:
    """Numbers of the rig.

    Attributes
    ----------
    camera_deg, projector_deg : opening angles across, degrees.
    lit_from_m : depth from which on the projector lights all that either camera sees.
    common_from_m : depth from which on both cameras see a common strip.
    pitch_m : width of a fringe on the reference plane, metres; ``fringes`` of them across one view.
    common : depth, width of one view in metres, share of it that the other camera sees too.
    """

    camera_deg: float
    projector_deg: float
    lit_from_m: float
    common_from_m: float
    pitch_m: float
    fringes: float
    common: tuple[tuple[float, float, float], ...]


def measure() -> Plan:
    """Work the numbers out from the rig's matrices, on a grid of depths where there is no formula in use."""
    depths = np.arange(0.05, 2.0, 1e-4)
    left, right, light = (device.borders_m(depths) for device in (LEFT, RIGHT, PROJECTOR))
    dark = (light[0] > left[0]) | (light[1] < right[1])
    apart = left[1] <= right[0]
    common = []
    for depth in DEPTHS_M:
        ends = LEFT.borders_m(depth)
        width = float(ends[1] - ends[0])
        common.append((depth, width, float(ends[1] - RIGHT.borders_m(depth)[0]) / width))
    edges = PROJECTOR.x_at(PERIOD_PX, REFERENCE_DEPTH_M) - PROJECTOR.x_at(0.0, REFERENCE_DEPTH_M)
    return Plan(
        camera_deg=LEFT.angle_deg,
        projector_deg=PROJECTOR.angle_deg,
        lit_from_m=float(depths[dark].max()) + 1e-4,
        common_from_m=float(depths[apart].max()) + 1e-4,
        pitch_m=float(edges),
        fringes=IMAGE_SIZE[0] / PERIOD_PX,
        common=tuple(common),
    )


def draw(numbers: Plan, path: Path) -> None:
    """Plan to scale, and the head itself enlarged."""
    figure = Figure(figsize=(9.5, 8.0), layout="constrained")
    plan, close = figure.subplots(1, 2, width_ratios=(3, 2))
    depths = np.array([0.0, 1.65])
    for device in (LEFT, RIGHT, PROJECTOR):
        low, high = device.borders_m(depths)
        for axes in (plan, close):
            axes.fill_betweenx(depths * 1e3, low * 1e3, high * 1e3, color=device.colour, alpha=0.16, lw=0)
            axes.plot(np.stack([low, high], 1) * 1e3, depths * 1e3, color=device.colour, lw=1.2)
            axes.plot(device.x_m * 1e3, 0.0, "o", color=device.colour, label=device.name)
        close.annotate(f"{device.x_m * 1e3:.0f} mm", (device.x_m * 1e3, -18.0), ha="center", color=device.colour)
    for crest in np.arange(0.0, PROJECTOR_SIZE[0], 4 * PERIOD_PX):
        plan.plot(PROJECTOR.x_at(crest, depths) * 1e3, depths * 1e3, color=GREEN, lw=0.4)
    plan.axhline(REFERENCE_DEPTH_M * 1e3, color=GREY, ls="--")
    plan.axhline(numbers.lit_from_m * 1e3, color=GREY, ls=":")
    plan.annotate(
        f"both views lit from {numbers.lit_from_m * 1e3:.0f} mm on", (-640, numbers.lit_from_m * 1e3 + 12), fontsize=8
    )
    plan.annotate("reference plane, 1500 mm", (-640, 1515), fontsize=8)
    plan.set(
        title="to scale (every fourth fringe)", xlabel="x (mm)", ylabel="z (mm)", xlim=(-650, 750), ylim=(-60, 1650)
    )
    plan.set_aspect("equal")
    plan.legend(loc="lower right", fontsize=8)
    close.set(title="the head, enlarged", xlabel="x (mm)", ylabel="z (mm)", xlim=(-60, 160), ylim=(-28, 320))
    close.set_aspect("equal")
    save(figure, path)


def experiment(plan: Plan) -> Experiment:
    """Tell the numbers."""
    rows = tuple((f"{z * 1e3:.0f}", f"{width * 1e3:.0f}", f"{100 * share:.1f}") for z, width, share in plan.common)
    note = "Width of one camera's view, and how much of it the other camera sees too."
    table = Table("Common view", note, ("distance mm", "view mm", "seen by both %"), rows)
    text = (
        f"Each camera opens {plan.camera_deg:.1f} degrees across, the projector {plan.projector_deg:.1f}; it lights "
        f"all that either camera sees from {plan.lit_from_m * 1e3:.0f} mm on. The views begin to overlap at "
        f"{plan.common_from_m * 1e3:.0f} mm. The paper does not give the projector's size: 960 columns are ours."
    )
    claim = Claim(
        "8",
        "fringes of 20 mm on the reference plane at 1500 mm",
        f"{plan.pitch_m * 1e3:.2f} mm, {number(PERIOD_PX, 2)} px, {plan.fringes:.1f} fringes across a view",
        "yes, by construction",
    )
    return Experiment("fig08_rig", "Figure 8: the rig", text, (table,), (claim,), partial(draw, plan))
