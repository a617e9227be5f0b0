"""The virtual head and the reconstruction with their live view as a web page; the address is in the log."""

from ament_index_python.packages import get_package_share_path
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

ARGUMENTS = {
    "namespace": ("head", "namespace of all topics"),
    "host": ("127.0.0.1", "address to serve the page at; not loopback: others see it"),
    "port": ("8080", "TCP port of the page; 0: any free one"),
}


def argument(name, kind=str):
    """Value of a launch argument as a node's parameter of a type."""
    return ParameterValue(LaunchConfiguration(name), value_type=kind)


def generate_launch_description():
    """Arguments of demo.launch.py are taken too."""
    demo = str(get_package_share_path("moire_sensor") / "launch" / "demo.launch.py")
    viewer = {"host": argument("host"), "port": argument("port", int)}
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=text)
                for name, (default, text) in ARGUMENTS.items()
            ),
            IncludeLaunchDescription(PythonLaunchDescriptionSource(demo)),
            Node(package="moire_sensor", executable="moire_viewer", namespace=LaunchConfiguration("namespace"),
                 parameters=[viewer], output="screen"),
        ]
    )  # fmt: skip
