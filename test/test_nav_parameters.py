"""Parameter files for Nav2 and STVL: every name exists there, with a value of the type that is declared there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from moire_sensor.ros import reconstruction_settings
from moire_sensor.ros.result_messages import TOPICS

ROOT = Path(__file__).parents[1]
# As declared by nav2_costmap_2d (Jazzy) and spatio_temporal_voxel_layer (branch ros2); rclcpp takes no int for a float.
COSTMAP = {
    "update_frequency": float, "publish_frequency": float, "global_frame": str, "robot_base_frame": str,
    "rolling_window": bool, "width": int, "height": int, "resolution": float, "plugins": list,
}  # fmt: skip
OBSTACLE_LAYER = {
    "plugin": str, "enabled": bool, "footprint_clearing_enabled": bool, "min_obstacle_height": float,
    "max_obstacle_height": float, "combination_method": int, "observation_sources": str,
}  # fmt: skip
VOXEL_LAYER = OBSTACLE_LAYER | {
    "z_voxels": int, "origin_z": float, "z_resolution": float, "unknown_threshold": int, "mark_threshold": int,
    "publish_voxel_map": bool,
}  # fmt: skip
NAV2_SOURCE = {
    "topic": str, "sensor_frame": str, "observation_persistence": float, "expected_update_rate": float,
    "data_type": str, "min_obstacle_height": float, "max_obstacle_height": float, "inf_is_valid": bool,
    "marking": bool, "clearing": bool, "obstacle_max_range": float, "obstacle_min_range": float,
    "raytrace_max_range": float, "raytrace_min_range": float,
}  # fmt: skip
STVL_LAYER = {
    "plugin": str, "observation_sources": str, "transform_tolerance": float, "enabled": bool,
    "publish_voxel_map": bool, "voxel_size": float, "combination_method": int, "mark_threshold": int,
    "update_footprint_enabled": bool, "track_unknown_space": bool, "decay_model": int, "voxel_decay": float,
    "mapping_mode": bool, "map_save_duration": float,
}  # fmt: skip
STVL_SOURCE = {
    "topic": str, "sensor_frame": str, "observation_persistence": float, "expected_update_rate": float,
    "data_type": str, "min_obstacle_height": float, "max_obstacle_height": float, "inf_is_valid": bool,
    "marking": bool, "clearing": bool, "obstacle_range": float, "min_z": float, "max_z": float,
    "vertical_fov_angle": float, "vertical_fov_padding": float, "horizontal_fov_angle": float,
    "decay_acceleration": float, "filter": str, "voxel_min_points": int, "clear_after_reading": bool, "enabled": bool,
    "model_type": int,
}  # fmt: skip
FILES: dict[str, tuple[str, dict[str, type], dict[str, type]]] = {
    "nav2_obstacle_layer": ("nav2_costmap_2d::ObstacleLayer", OBSTACLE_LAYER, NAV2_SOURCE),
    "nav2_voxel_layer": ("nav2_costmap_2d::VoxelLayer", VOXEL_LAYER, NAV2_SOURCE),
    "stvl_layer": ("spatio_temporal_voxel_layer/SpatioTemporalVoxelLayer", STVL_LAYER, STVL_SOURCE),
}


def parameters_of(file: str) -> dict[str, Any]:
    content = yaml.safe_load((ROOT / "config" / f"{file}.yaml").read_text())
    found: dict[str, Any] = content["local_costmap"]["local_costmap"]["ros__parameters"]
    return found


def check_types(values: dict[str, Any], known: dict[str, type], but: set[str]) -> None:
    for name, value in values.items():
        if name not in but:
            assert type(value) is known[name], name


@pytest.mark.parametrize("file", FILES)
def test_names_and_types_are_those_that_the_layers_declare(file: str) -> None:
    plugin, layer_names, source_names = FILES[file]
    costmap = parameters_of(file)
    layer_name = costmap["plugins"][0]
    layer = costmap[layer_name]
    assert layer["plugin"] == plugin
    sources = layer["observation_sources"].split()
    check_types(costmap, COSTMAP, set(costmap["plugins"]))
    check_types(layer, layer_names, set(sources))
    for source in sources:
        check_types(layer[source], source_names, set())
        assert layer[source]["data_type"] == "PointCloud2"
        assert layer[source]["topic"].removeprefix("/head/") in TOPICS


@pytest.mark.parametrize("layer", ["obstacle_layer", "voxel_layer"])
def test_floor_points_reach_the_layer_to_clear_but_are_not_marked(layer: str) -> None:
    """A source's heights cut what clears too; the layer's own cut what is marked."""
    content = parameters_of(f"nav2_{layer}")[layer]
    assert content["min_obstacle_height"] > 0.0
    for source in content["observation_sources"].split():
        assert content[source]["min_obstacle_height"] < 0.0 < content[source]["max_obstacle_height"]


def test_ranges_of_sensor_and_layers_agree() -> None:
    values = yaml.safe_load((ROOT / "config" / "navigation.yaml").read_text())["/**/reconstruction"]["ros__parameters"]
    specs = {spec.name: spec for spec in reconstruction_settings.SPECS}
    for name, value in values.items():
        specs[name].check(value)
    assert values["nav_max_range_m"] < values["max_depth_m"]
    for layer in ("obstacle_layer", "voxel_layer"):
        assert parameters_of(f"nav2_{layer}")[layer]["head"]["obstacle_max_range"] == values["nav_max_range_m"]
    assert parameters_of("stvl_layer")["stvl_layer"]["head_mark"]["obstacle_range"] == values["nav_max_range_m"]
