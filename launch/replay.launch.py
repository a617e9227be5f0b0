"""A recorded bag of a head's topics, played by ros2 bag into the reconstruction."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.conditions import IfCondition, UnlessCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

ARGUMENTS = {
    "namespace": ("head", "namespace that the bag was recorded in"),
    "rate": ("1.0", "speed of the replay; 1 is that of the recording"),
    "loop": ("false", "play again from the start"),
    "method": ("dense", "dense or phase_shift"),
}


def generate_launch_description():
    """Nothing is lost: the reconstruction subscribes reliable and queues."""
    play = ["ros2", "bag", "play", LaunchConfiguration("bag"), "--rate", LaunchConfiguration("rate")]
    looped = LaunchConfiguration("loop")
    reconstruction = {
        "method": ParameterValue(LaunchConfiguration("method"), value_type=str),
        "reliable_input": True,
        "queue_depth": 50,
    }
    return LaunchDescription(
        [
            DeclareLaunchArgument("bag", description="folder of the bag"),
            *(
                DeclareLaunchArgument(name, default_value=default, description=text)
                for name, (default, text) in ARGUMENTS.items()
            ),
            Node(
                package="moire_sensor",
                executable="reconstruction",
                namespace=LaunchConfiguration("namespace"),
                parameters=[reconstruction],
                output="screen",
            ),
            ExecuteProcess(cmd=play, output="screen", condition=UnlessCondition(looped)),
            ExecuteProcess(cmd=[*play, "--loop"], output="screen", condition=IfCondition(looped)),
        ]
    )
