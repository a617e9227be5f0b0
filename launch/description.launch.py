"""The head's TF from its URDF, where robot_state_publisher is installed; RViz and the place on a robot if asked for."""

from ament_index_python.packages import PackageNotFoundError, get_package_prefix, get_package_share_path
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, LogInfo
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, NotEqualsSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

ARGUMENTS = {
    "namespace": ("head", "namespace of the head"),
    "frame_prefix": ("", "put before the names of the head's frames, e.g. left/"),
    "base_frame": ("", "frame of the robot that carries the head, e.g. base_link; empty: told elsewhere"),
    "x": ("0.0", "of head_base_link in base_frame, m"),
    "y": ("0.0", "of head_base_link in base_frame, m"),
    "z": ("0.0", "of head_base_link in base_frame, m"),
    "yaw": ("0.0", "of head_base_link in base_frame, rad"),
    "rviz": ("false", "also start RViz"),
}


def nodes_of_other_packages():
    """Nodes by package; those not installed are left out with a word."""
    namespace, prefix = LaunchConfiguration("namespace"), LaunchConfiguration("frame_prefix")
    share = get_package_share_path("moire_sensor")
    description = ParameterValue((share / "urdf" / "head.urdf").read_text(), value_type=str)
    place = [word for name in ("x", "y", "z", "yaw") for word in (f"--{name}", LaunchConfiguration(name))]
    frames = ["--frame-id", LaunchConfiguration("base_frame"), "--child-frame-id", [prefix, "head_base_link"]]
    return {
        # It makes /tf of this and of the head's joint_states.
        "robot_state_publisher": {
            "executable": "robot_state_publisher",
            "parameters": [{"robot_description": description, "frame_prefix": prefix}],
            "namespace": namespace,
        },
        "tf2_ros": {
            "executable": "static_transform_publisher",
            "arguments": place + frames,
            "namespace": namespace,
            "condition": IfCondition(NotEqualsSubstitution(LaunchConfiguration("base_frame"), "")),
        },
        "rviz2": {
            "executable": "rviz2",
            "arguments": ["-d", str(share / "rviz" / "head.rviz")],
            "condition": IfCondition(LaunchConfiguration("rviz")),
        },
    }


def generate_launch_description():
    """Start what is there."""
    actions = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    for package, options in nodes_of_other_packages().items():
        try:
            get_package_prefix(package)
        except PackageNotFoundError:
            actions.append(LogInfo(msg=f"{package} is not installed here: started without it"))
        else:
            actions.append(Node(package=package, **options))
    return LaunchDescription(actions)
