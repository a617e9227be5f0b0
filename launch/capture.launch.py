"""A recorded capture folder, played into the reconstruction."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

ARGUMENTS = {
    "namespace": ("head", "namespace of all topics"),
    "rate_hz": ("10.0", "exposures per second"),
    "loop": ("true", "play again from the start"),
    "method": ("phase_shift", "dense or phase_shift"),
}


def argument(name, kind=str):
    """Value of a launch argument as a node's parameter of a type."""
    return ParameterValue(LaunchConfiguration(name), value_type=kind)


def generate_launch_description():
    """Nothing is lost: the reconstruction subscribes reliable and queues, the player waits for it."""
    namespace = LaunchConfiguration("namespace")
    player = {"folder": argument("folder"), "rate_hz": argument("rate_hz", float), "loop": argument("loop", bool)}
    reconstruction = {"method": argument("method"), "reliable_input": True, "queue_depth": 50}
    return LaunchDescription(
        [
            DeclareLaunchArgument("folder", description="left_NN.png, right_NN.png and rig.yaml"),
            *(
                DeclareLaunchArgument(name, default_value=default, description=text)
                for name, (default, text) in ARGUMENTS.items()
            ),
            Node(package="moire_sensor", executable="capture_player", namespace=namespace, parameters=[player],
                 output="screen"),
            Node(package="moire_sensor", executable="reconstruction", namespace=namespace,
                 parameters=[reconstruction], output="screen"),
        ]
    )  # fmt: skip
