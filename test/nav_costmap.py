"""A costmap as Nav2 describes it, for tests: heights, ranges, marking and clearing of obstacle and voxel layer.

Names and defaults are those of nav2_costmap_2d (Jazzy). One layer, no inflation, no footprint; unknown is not tracked.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Cell = tuple[int, int]


@dataclass(frozen=True)
class Source:
    """One observation source; the defaults are Nav2's, some of which leave a sensor silent."""

    topic: str
    data_type: str = "LaserScan"
    marking: bool = True
    clearing: bool = False
    min_obstacle_height: float = 0.0
    max_obstacle_height: float = 0.0
    obstacle_min_range: float = 0.0
    obstacle_max_range: float = 2.5
    raytrace_min_range: float = 0.0
    raytrace_max_range: float = 3.0


@dataclass(frozen=True)
class Observation:
    """Points (N, 3) of one message in the costmap's frame, cut to the source's heights, and where the sensor was."""

    source: Source
    origin_m: Array
    points_m: Array

    @classmethod
    def of(cls, source: Source, origin_m: Array, points_m: Array) -> Observation:
        height = points_m[:, 2]
        return cls(
            source,
            origin_m,
            points_m[(height >= source.min_obstacle_height) & (height <= source.max_obstacle_height)],
        )


@dataclass
class Costmap:
    """A square map around the robot; ``lethal`` holds the cells (column along x, row along y) marked now."""

    parameters: dict[str, Any]
    layer: dict[str, Any]
    lethal: set[Cell] = field(default_factory=set)

    @property
    def resolution_m(self) -> float:
        return float(self.parameters["resolution"])

    @property
    def size(self) -> Cell:
        return tuple(round(self.parameters[side] / self.resolution_m) for side in ("width", "height"))  # type: ignore[return-value]

    @property
    def origin_m(self) -> Array:
        return np.array([-self.parameters["width"] / 2.0, -self.parameters["height"] / 2.0])

    def sources(self) -> dict[str, Source]:
        names = {item.name for item in fields(Source)}
        found = {}
        for name in self.layer["observation_sources"].split():
            values = self.layer[name]
            assert set(values) <= names, f"{name}: {set(values) - names} is no parameter known here"
            found[name] = Source(**values)
        return found

    def indices(self, points_m: Array) -> npt.NDArray[np.int64]:
        """Column and row (N, 2) of points, also of those off the map."""
        return np.floor((points_m[:, :2] - self.origin_m) / self.resolution_m).astype(np.int64)

    def on_map(self, points_m: Array) -> npt.NDArray[np.bool_]:
        """Which points (N,) lie on the map."""
        indices = self.indices(points_m)
        return np.asarray(((indices >= 0) & (indices < self.size)).all(axis=-1))

    def cells(self, points_m: Array) -> list[Cell]:
        """Cell of each point on the map; the others are left out."""
        return [(x, y) for x, y in self.indices(points_m[self.on_map(points_m)]).tolist()]

    def touched(self, points_m: Array) -> set[Cell]:
        """Cells that hold a point."""
        column, row = self.indices(points_m[self.on_map(points_m)]).T
        numbers = np.unique(column * self.size[1] + row)
        return {divmod(number, self.size[1]) for number in numbers.tolist()}

    def update(self, observations: list[Observation]) -> None:
        """Clear along the rays first, then mark: what is seen now always stands."""
        for one in observations:
            if one.source.clearing:
                self.clear(one)
        for one in observations:
            if one.source.marking:
                self.mark(one)

    def markable(self, one: Observation, dimensions: int) -> Array:
        """Points within the layer's heights and the source's range, measured in 2 or 3 dimensions."""
        offset = (one.points_m - one.origin_m)[:, :dimensions]
        distance_m = np.linalg.norm(offset, axis=-1)
        height = one.points_m[:, 2]
        kept = (height >= self.layer["min_obstacle_height"]) & (height <= self.layer["max_obstacle_height"])
        kept &= (distance_m >= one.source.obstacle_min_range) & (distance_m <= one.source.obstacle_max_range)
        return one.points_m[kept]

    def mark(self, one: Observation) -> None:
        """Obstacle layer: ranges are measured on the map."""
        self.lethal.update(self.touched(self.markable(one, 2)))

    def clear(self, one: Observation) -> None:
        """Obstacle layer: every cell of the ray's footprint, the last one too."""
        start = np.floor((one.origin_m[:2] - self.origin_m) / self.resolution_m).astype(int)
        longest = math.ceil(one.source.raytrace_max_range / self.resolution_m)
        for end in np.unique(self.indices(one.points_m), axis=0):
            self.lethal.difference_update((x, y) for x, y in line(start, end, longest))


@dataclass
class VoxelCostmap(Costmap):
    """The voxel layer: columns of up to 16 voxels, cleared in three dimensions."""

    marked: dict[Cell, set[int]] = field(default_factory=dict)

    def voxels(self, points_m: Array) -> npt.NDArray[np.int64]:
        low = np.array([*self.origin_m, self.layer["origin_z"]])
        steps = np.array([self.resolution_m, self.resolution_m, self.layer["z_resolution"]])
        return np.floor((points_m - low) / steps).astype(np.int64)

    def mark(self, one: Observation) -> None:
        """Ranges are measured in space; points below the grid fall into its lowest voxels."""
        points_m = self.markable(one, 3).copy()
        points_m[:, 2] = np.maximum(points_m[:, 2], self.layer["origin_z"])
        inside = (self.voxels(points_m)[:, 2] < self.layer["z_voxels"]) & self.on_map(points_m)
        for x, y, z in np.unique(self.voxels(points_m[inside]), axis=0).tolist():
            self.marked.setdefault((x, y), set()).add(z)
            if len(self.marked[x, y]) > self.layer["mark_threshold"]:
                self.lethal.add((x, y))

    def clear(self, one: Observation) -> None:
        """Rays end two cells before their point, and where they leave the grid."""
        start = self.voxels(one.origin_m[None])[0]
        assert 0 <= start[2] < self.layer["z_voxels"], "Nav2 clears nothing for a sensor outside the voxel grid"
        longest = math.ceil(one.source.raytrace_max_range / self.resolution_m)
        for end in np.unique(self.voxels(self.ray_ends(one)), axis=0):
            for x, y, z in line(start, end, longest):
                column = self.marked.get((x, y))
                if column and z in column:
                    column.remove(z)
                    if len(column) <= self.layer["mark_threshold"]:
                        self.lethal.discard((x, y))

    def ray_ends(self, one: Observation) -> Array:
        offset = one.points_m - one.origin_m
        length_m = np.linalg.norm(offset, axis=-1, keepdims=True)
        offset = offset * np.maximum((length_m - 2.0 * self.resolution_m) / length_m, 0.0)
        low = np.array([*self.origin_m, self.layer["origin_z"]]) + 1e-5
        high = np.array([*-self.origin_m, self.layer["origin_z"] + self.layer["z_voxels"] * self.layer["z_resolution"]])
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = np.where(offset > 0, (high - 0.01 - one.origin_m) / offset, (low - one.origin_m) / offset)
        share = np.where(offset == 0.0, np.inf, shares).min(axis=-1, keepdims=True)
        return np.asarray(one.origin_m + offset * np.minimum(share, 1.0))


def line(start: npt.NDArray[Any], end: npt.NDArray[Any], longest: int) -> Iterator[tuple[int, ...]]:
    """Cells or voxels from start to end by Bresenham's algorithm, cut to ``longest`` cells of length."""
    delta = end - start
    steps = int(np.abs(delta).max())
    length = float(np.linalg.norm(delta))
    last = int(min(1.0, longest / length) * steps) if length else 0
    error = np.full(len(delta), steps // 2)
    at = np.array(start)
    for _ in range(last + 1):
        yield tuple(int(value) for value in at)
        error += np.abs(delta)
        over = error >= max(steps, 1)
        at = at + np.where(over, np.sign(delta), 0)
        error = np.where(over, error - steps, error)
