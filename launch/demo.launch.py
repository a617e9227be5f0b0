"""The virtual head and the reconstruction; TF and RViz where a full ROS 2 has them."""

from ament_index_python.packages import get_package_share_path
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.conditions import IfCondition, UnlessCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

ARGUMENTS = {
    "namespace": ("head", "namespace of all topics"),
    "frame_prefix": ("", "put before the names of all frames, e.g. left/"),
    "scene": ("room", "what the head looks at, e.g. flat_board:distance_m=0.8"),
    "rate_hz": ("10.0", "exposures per second"),
    "start_offset": ("0.0", "share of the period at which this head has its turn: 0.5 for the second of two"),
    "seed": ("0", "of the camera noise"),
    "phase_steps": ("1", "exposures of one programme; 4 for method phase_shift"),
    "method": ("dense", "dense or phase_shift"),
    "composed": ("false", "head and reconstruction in one process"),
    "rviz": ("false", "also start RViz"),
}


def argument(name, kind=str):
    """Value of a launch argument as a node's parameter of a type."""
    return ParameterValue(LaunchConfiguration(name), value_type=kind)


def generate_launch_description():
    """Nothing is lost in the demo: the reconstruction subscribes reliable and queues."""
    composed = LaunchConfiguration("composed")
    common = {"package": "moire_sensor", "namespace": LaunchConfiguration("namespace"), "output": "screen"}
    description = str(get_package_share_path("moire_sensor") / "launch" / "description.launch.py")
    head = {"scene": argument("scene"), "rate_hz": argument("rate_hz", float), "seed": argument("seed", int),
            "phase_steps": argument("phase_steps", int), "frame_prefix": argument("frame_prefix"),
            "start_offset": argument("start_offset", float), "wait_for_subscribers": 1}  # fmt: skip
    reconstruction = {"method": argument("method"), "reliable_input": True, "queue_depth": 50}
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=text)
                for name, (default, text) in ARGUMENTS.items()
            ),
            Node(executable="moire_demo", parameters=[head, reconstruction], condition=IfCondition(composed), **common),
            Node(executable="virtual_head", parameters=[head], condition=UnlessCondition(composed), **common),
            Node(executable="reconstruction", parameters=[reconstruction], condition=UnlessCondition(composed),
                 **common),
            IncludeLaunchDescription(PythonLaunchDescriptionSource(description)),
        ]
    )  # fmt: skip
