"""A plate before a wall, seen by both cameras pixel by pixel, and the slow loop of the assignment of borders."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from dense_rigs import Array, Float32

from moire_sensor import depth_border as border
from moire_sensor import depth_narrow, depth_trust, depth_window
from moire_sensor import depth_offer as fit
from moire_sensor.depth_refine import Match
from moire_sensor.paper_rig import paper_pattern, paper_rig
from moire_sensor.phase_image import PhaseImage
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.settings import Settings

Mask = npt.NDArray[np.bool_]
NOISE = 1.5
AMPLITUDE, BACKGROUND = 70.0, 90.0
RIM, JUMP, STEP = fit.RIM_PX, depth_trust.JUMP_PX, depth_narrow.STEP_PX
PROJECTOR = ProjectorMap.build(paper_rig(), paper_pattern())


@dataclass(frozen=True)
class Scene:
    """A wall of sloped disparity and a plate before it; the strip right of the plate lies in the projector's shadow."""

    shape: tuple[int, int] = (60, 220)
    wall_px: float = 12.0
    plate_px: float = 24.0
    rows: tuple[int, int] = (15, 45)
    columns: tuple[int, int] = (90, 150)
    shadow_px: int = 20
    noise: float = NOISE
    seed: int = 0

    @property
    def plate(self) -> Mask:
        return self.on_plate(*np.indices(self.shape))

    @property
    def shadow(self) -> Mask:
        return self.in_shadow(*np.indices(self.shape))

    @property
    def hidden(self) -> Mask:
        """Pixels of the wall that the plate hides from the right camera, and those it does not see at all."""
        y, x = np.indices(self.shape)
        behind = self.on_plate(y, np.rint(x - self.wall(x, y)) + self.plate_px) & ~self.plate
        return np.asarray(behind | (x - self.disparity_px < 0.0))

    @property
    def disparity_px(self) -> Array:
        y, x = np.indices(self.shape, dtype=float)
        return np.where(self.plate, self.plate_px, self.wall(x, y))

    def wall(self, x: Array, y: Array) -> Array:
        return self.wall_px + 0.01 * x - 0.02 * y

    def on_plate(self, y: Array, x: Array) -> Mask:
        inside = (self.rows[0] <= y) & (y < self.rows[1]) & (self.columns[0] <= x) & (x < self.columns[1])
        return np.asarray(inside)

    def in_shadow(self, y: Array, x: Array) -> Mask:
        end = self.columns[1]
        return np.asarray((self.rows[0] <= y) & (y < self.rows[1]) & (end <= x) & (x < end + self.shadow_px))

    def grey(self, y: Array, x: Array, disparity: Array, dark: Mask) -> Array:
        lit = BACKGROUND + AMPLITUDE * np.cos(PROJECTOR.phase_rad_at(x, y, disparity))
        return np.where(dark, BACKGROUND - AMPLITUDE - 15.0, lit)

    def views(self) -> tuple[Float32, Float32]:
        """Left and right image with noise of their own."""
        rng = np.random.default_rng(self.seed)
        y, x = np.indices(self.shape, dtype=float)
        left = self.grey(y, x, self.disparity_px, self.shadow)
        front = self.on_plate(y, x + self.plate_px)
        # Left pixel of the wall that falls on right column x: x_left - wall(x_left) = x.
        behind = (x + self.wall_px - 0.02 * y) / 0.99
        seen = np.where(front, x + self.plate_px, behind)
        disparity = np.where(front, self.plate_px, self.wall(behind, y))
        right = self.grey(y, seen, disparity, ~front & self.in_shadow(y, behind))
        noisy = [np.float32(view + rng.normal(0.0, self.noise, self.shape)) for view in (left, right)]
        return noisy[0], noisy[1]

    def phase(self) -> PhaseImage:
        flat = np.zeros(self.shape, dtype=np.float32)
        return PhaseImage(flat, flat + np.float32(AMPLITUDE), flat + np.float32(BACKGROUND), flat + np.float32(0.01),
                          np.zeros(self.shape, dtype=np.uint8))  # fmt: skip

    def match(self, disparity: Array) -> Match:
        flat = np.zeros(self.shape, dtype=np.float32)
        return Match(
            disparity.astype(np.float32), flat + np.float32(0.02), flat + np.float32(-0.1), flat + np.float32(0.1)
        )


def slow_trusted(disparity: Float32) -> Mask:
    height, width = disparity.shape
    jump = np.isnan(disparity)
    jump[:, :-1] |= ~(np.abs(disparity[:, 1:] - disparity[:, :-1]) <= depth_trust.JUMP_PX)
    jump[:-1] |= ~(np.abs(disparity[1:] - disparity[:-1]) <= depth_trust.JUMP_PX)
    return np.array([[not jump[max(y - RIM, 0) : y + RIM + 1, max(x - RIM, 0) : x + RIM + 1].any()
                      for x in range(width)] for y in range(height)])  # fmt: skip


def slow_claims(disparity: Float32, trust: Mask) -> Float32:
    claim = np.full(disparity.shape, fit.NO_CLAIM, dtype=np.float32)
    for y, x in np.argwhere(trust):
        falls = float(np.float32(x) - disparity[y, x])
        for column in (int(np.floor(falls)), int(np.floor(falls)) + 1):
            if 0 <= column < disparity.shape[1]:
                claim[y, column] = max(claim[y, column], disparity[y, x])
    return claim


def slow_difference(views: tuple[Float32, Float32], y: int, x: int, plane: tuple[float, float, float]) -> float:
    """Lowest mean difference, at most the amplitude at each pixel, of the three windows that hold (y, x)."""
    left, right = views
    height, width = left.shape
    means = []
    for middle in (x - 2, x, x + 2):
        values = []
        for row in range(max(y - 1, 0), min(y + 2, height)):
            for column in range(max(middle - 2, 0), min(middle + 3, width)):
                seen = column - (plane[0] + plane[1] * (column - x) + plane[2] * (row - y))
                if 0.0 <= seen < width - 1:
                    apart = abs(float(left[row, column]) - np.interp(seen, np.arange(width), right[row]))
                    values.append(min(apart, AMPLITUDE))
        means.append(np.mean(values) if len(values) >= 8 else np.inf)
    return float(min(means))


def slow_row_match(
    views: tuple[Float32, Float32], y: int, x: int, plane: tuple[float, float, float], first: int, last: int
) -> tuple[float, float, float]:
    """Least squares of the shift along a piece of row: shift, mean squared slope, variance."""
    left, right = views[0][y].astype(float), views[1][y].astype(float)
    width = left.size
    at = np.arange(max(first, 0), min(last, width - 1) + 1)
    seen = at - (plane[0] + plane[1] * (at - x))
    at, seen = at[(seen >= 1.0) & (seen < width - 2)], seen[(seen >= 1.0) & (seen < width - 2)]
    if at.size < depth_window.ROW_SPAN_PX // 2:
        return 0.0, 0.0, np.inf
    slopes = np.interp(seen, np.arange(width), np.gradient(right))
    differences = left[at] - np.interp(seen, np.arange(width), right)
    power = float(slopes @ slopes) + 1e-3
    # left(x) = right(x - d - s) = right(x - d) - s slope
    shift = -float(slopes @ differences) / power
    rest = differences + shift * slopes
    return shift, power / at.size, float(rest @ rest) / at.size / power


def is_taken(claim: Float32, y: int, x: int, disparity: float) -> bool:
    column = int(np.floor(x - disparity + 0.5))
    if not 0 <= column < claim.shape[1]:
        return True
    return bool(claim[y, column] > fit.NO_CLAIM and abs(claim[y, column] - disparity) > fit.SAME_CLAIM_PX)


def slow_neighbours(trust: Mask, y: int, x: int) -> list[tuple[int, int]]:
    """Nearest trusted pixels left, right, above, below, that lie in reach and not at the image's border."""
    height, width = trust.shape
    reaches = ((0, -1, width), (0, 1, width), (-1, 0, depth_trust.REACH_PX), (1, 0, depth_trust.REACH_PX))
    found = []
    for down, aside, reach in reaches:
        for away in range(1, reach + 1):
            y0, x0 = y + down * away, x + aside * away
            if not (0 <= y0 < height and 0 <= x0 < width):
                break
            if trust[y0, x0]:
                if RIM <= y0 < height - RIM and RIM <= x0 < width - RIM and abs(x0 - x) <= depth_trust.ROW_REACH_PX:
                    found.append((y0, x0))
                break
    return found


Plane = tuple[float, float, float]


def slow_plane(disparity: Float32, y: int, x: int, y0: int, x0: int) -> Plane:
    """What the plane of trusted pixel (y0, x0) offers to (y, x)."""
    along = float(disparity[y0, x0 + RIM] - disparity[y0, x0 - RIM]) / (2 * RIM)
    across = float(disparity[y0 + RIM, x0] - disparity[y0 - RIM, x0]) / (2 * RIM)
    return float(disparity[y0, x0]) + along * (x - x0) + across * (y - y0), along, across


def has_narrow_run(line: Float32, trust: Mask, x: int) -> bool:
    """Whether between the trusted pixels around column x there is a run that holds none of them."""
    breaks = [0, *(at for at in range(1, line.size) if not abs(line[at] - line[at - 1]) < STEP), line.size]
    start, end = x, x
    while start > 0 and not trust[start - 1]:
        start -= 1
    while end < line.size and not trust[end]:
        end += 1
    return any(start <= a and b <= end and b - a >= depth_narrow.LEAST_RUN_PX for a, b in itertools.pairwise(breaks))


def slow_runs(disparity: Float32, trust: Mask, y: int, x: int) -> list[tuple[int, Plane, bool]]:
    """First columns of the runs left and right that offer something, that, and whether only if nothing else is."""
    height, width = disparity.shape
    found = []
    narrow = has_narrow_run(disparity[y], trust[y], x)
    for step in (-1, 1):
        line = [float(disparity[y, at]) for at in (range(x, width) if step > 0 else range(x, -1, -1))]
        reliable = [bool(trust[y, x + step * away]) for away in range(len(line))]
        other = [away for away, d in enumerate(line) if away and np.isfinite(d) and not abs(d - line[0]) < STEP]
        if not other or other[0] > depth_narrow.LOOK_PX:
            continue
        first = end = other[0]
        while end + 1 < len(line) and abs(line[end + 1] - line[end]) < STEP:
            end += 1
        rows = [max(y - depth_narrow.UPRIGHT_PX, 0), min(y + depth_narrow.UPRIGHT_PX, height - 1)]
        upright = all(abs(disparity[row, x + step * first] - line[first]) < JUMP for row in rows)
        last = first + depth_narrow.LEAST_RUN_PX - 1
        if last > end or not upright:
            continue
        if not any(reliable[first : end + 1]):
            if not narrow and not (first == 1 and np.isnan(line[0])):
                continue
            along = (line[last] - line[first]) / (step * (last - first))
            found.append((x + step * first, (line[first] - along * step * first, along, 0.0), False))
        elif first == 1 and np.isnan(line[0]):
            found.append((x + step, (line[1], 0.0, 0.0), True))
    return found


def slow_offer(
    views: tuple[Float32, Float32], disparity: Float32, claim: Float32, y: int, x: int, x0: int, plane: Plane
) -> tuple[float, float, float] | None:
    """Difference in amplitudes, disparity and sigma of a plane offered from column x0, None where it is refused."""
    d, along, across = plane
    phase_rad = float(PROJECTOR.phase_rad_at(np.array(float(x)), np.array(float(y)), d))
    lacks = BACKGROUND + AMPLITUDE * np.cos(phase_rad) - float(views[0][y, x])
    if lacks > fit.DIM_SHARE * AMPLITUDE + 3 * NOISE or -lacks > fit.GLARE_SHARE * AMPLITUDE + 3 * NOISE:
        return None
    if abs(d - disparity[y, x]) < depth_trust.JUMP_PX:
        return None
    first = {True: x, False: x - depth_window.ROW_SPAN_PX}[x0 > x] if x0 != x else x - depth_window.ROW_SPAN_PX // 2
    shift, power, variance = slow_row_match(views, y, x, (d, along, across), first, first + depth_window.ROW_SPAN_PX)
    fringe_power = 0.5 * (AMPLITUDE * PROJECTOR.rad_per_column) ** 2
    if power < fit.LEAST_POWER * fringe_power or abs(shift) > fit.LARGEST_MOVE_PX:
        return None
    if abs(x - x0) > fit.NEAR_PX and variance > fit.FAR_VARIANCE:
        return None
    moved = shift if abs(shift) > fit.MOVE_PX else 0.0
    d += moved
    if is_taken(claim, y, x, d):
        return None
    difference = slow_difference(views, y, x, (d, along, across)) / AMPLITUDE + fit.MOVE_COST * abs(moved)
    return difference, d, float(np.sqrt(variance))


def slow_lit(left: Float32, y: int, x: int, disparity: float, along: float) -> bool:
    """Whether a piece of row that holds the pixel has most of the light that the plane promises."""
    for first in (x - fit.LIT_PX // 2, x - fit.LIT_PX + 1, x):
        at = np.arange(max(first, 0), min(first + fit.LIT_PX, left.shape[1]))
        phase_rad = PROJECTOR.phase_rad_at(at.astype(float), np.full(at.size, float(y)), disparity + along * (at - x))
        promised = float((BACKGROUND + AMPLITUDE * np.cos(phase_rad)).sum())
        if left[y, at].sum() > fit.LIT_SHARE * promised - 3.0 * np.sqrt(fit.LIT_PX) * NOISE:
            return True
    return False


def rows_in_order(height: int, first_rows: int) -> list[tuple[int, int]]:
    """Rows, and how far away those are that were looked at before and may speak for them; 0 for none."""
    order = [(y, 0) for y in range(0, height, first_rows)]
    while first_rows > 1:
        first_rows //= 2
        order += [(y, first_rows) for y in range(first_rows, height, 2 * first_rows)]
    return order


def like_both(here: float, before: float, after: float) -> bool:
    """Whether a pixel is like those of two rows that were looked at: on their surface, or unknown as both."""
    if np.isnan(here):
        return bool(np.isnan(before) and np.isnan(after))
    return bool(abs(here - before) <= JUMP and abs(here - after) <= JUMP)


def slow_round(views: tuple[Float32, Float32], images: Array, trust: Mask, todo: Mask, first_rows: int) -> Array:
    """One round of the assignment on (4, H, W) images of a match."""
    disparity, result = images[0], images.copy()
    claim = slow_claims(disparity, trust)
    allowed = 2 * NOISE / AMPLITUDE + Settings().max_border_misfit
    height, width = disparity.shape
    for (y, away), x in itertools.product(rows_in_order(height, first_rows), range(width)):
        if trust[y, x] or not todo[y, x]:
            continue
        rows = result[0, [y - away, min(y + away, height - 1)], x]
        if away and y + away < height and like_both(disparity[y, x], *rows):
            continue
        planes = [(at[1], slow_plane(disparity, y, x, *at), False) for at in slow_neighbours(trust, y, x)]
        good: list[tuple[float, float, float]] = []
        for x0, plane, alone in planes + slow_runs(disparity, trust, y, x):
            offer = None if alone and good else slow_offer(views, disparity, claim, y, x, x0, plane)
            if offer is None or not np.isfinite(offer[0]):
                continue
            leads = all(offer[0] < other[0] for other in good)
            if not leads or slow_lit(views[0], y, x, offer[1], plane[1]):
                good.append(offer)
        best, chosen, sigma = min(good, key=lambda offer: offer[0], default=(np.inf, np.nan, np.nan))
        own, here = np.inf, float(disparity[y, x])
        if np.isfinite(here) and not is_taken(claim, y, x, here):
            own = slow_difference(views, y, x, (here, 0.0, 0.0)) / AMPLITUDE
        if best < allowed and best < own - border.BETTER_SHARE:
            result[:, y, x] = chosen, sigma, np.nan, best
        elif own > allowed:
            result[0, y, x] = np.nan
    return result


def slow_extend(views: tuple[Float32, Float32], match: Match, row_step: int) -> Array:
    """Both rounds on the (4, H, W) images of a match."""
    images = np.stack([match.disparity_px, match.sigma_px, match.signed_mismatch_rad, match.mismatch_rad])
    trust = fresh = slow_trusted(images[0])
    for _ in range(border.ROUNDS):
        height, width = fresh.shape
        reach, further = depth_trust.REACH_PX, depth_trust.REACH_PX + depth_trust.HOLE_REACH_PX
        near, holes = (
            np.array([[fresh[max(y - reach, 0) : y + reach + 1, max(x - aside, 0) : x + aside + 1].any()
                       for x in range(width)] for y in range(height)]) for aside in (reach, further)
        )  # fmt: skip
        todo = near | (holes & np.isnan(images[0]))
        images = slow_round(views, images, trust, todo, row_step)
        before, trust = trust, slow_trusted(images[0])
        fresh = trust & ~before
    return images
