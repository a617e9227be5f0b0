"""The virtual head and the reconstruction; TF and RViz where a full ROS 2 has them."""

from ament_index_python.packages import PackageNotFoundError, get_package_prefix, get_package_share_path
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, LogInfo
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

ARGUMENTS = {
    "namespace": ("head", "namespace of all topics"),
    "scene": ("room", "what the head looks at, e.g. flat_board:distance_m=0.8"),
    "rate_hz": ("10.0", "exposures per second"),
    "seed": ("0", "of the camera noise"),
    "phase_steps": ("1", "exposures of one programme; 4 for method phase_shift"),
    "method": ("dense", "dense or phase_shift"),
    "rviz": ("false", "also start RViz"),
}


def argument(name, kind=str):
    """Value of a launch argument as a node's parameter of a type."""
    return ParameterValue(LaunchConfiguration(name), value_type=kind)


def full_ros_nodes():
    """Nodes of other packages, left out with a word where they are not installed."""
    namespace = LaunchConfiguration("namespace")
    rviz_file = str(get_package_share_path("moire_sensor") / "rviz" / "head.rviz")
    wanted = {
        # The head publishes robot_description; this makes /tf of it and of joint_states.
        "robot_state_publisher": {"parameters": [{"robot_description": robot_description()}]},
        "rviz2": {"arguments": ["-d", rviz_file], "condition": IfCondition(LaunchConfiguration("rviz"))},
    }
    actions = []
    for package, options in wanted.items():
        try:
            get_package_prefix(package)
        except PackageNotFoundError:
            actions.append(LogInfo(msg=f"{package} is not installed here: started without it"))
        else:
            actions.append(Node(package=package, executable=package, namespace=namespace, **options))
    return actions


def robot_description():
    """The URDF as text."""
    return ParameterValue((get_package_share_path("moire_sensor") / "urdf" / "head.urdf").read_text(), value_type=str)


def generate_launch_description():
    """Nothing is lost in the demo: the reconstruction subscribes reliable and queues."""
    namespace = LaunchConfiguration("namespace")
    head = {"scene": argument("scene"), "rate_hz": argument("rate_hz", float), "seed": argument("seed", int),
            "phase_steps": argument("phase_steps", int), "wait_for_subscribers": 1}  # fmt: skip
    reconstruction = {"method": argument("method"), "reliable_input": True, "queue_depth": 50}
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=text)
                for name, (default, text) in ARGUMENTS.items()
            ),
            Node(package="moire_sensor", executable="virtual_head", namespace=namespace, parameters=[head],
                 output="screen"),
            Node(package="moire_sensor", executable="reconstruction", namespace=namespace,
                 parameters=[reconstruction], output="screen"),
            *full_ros_nodes(),
        ]
    )  # fmt: skip
