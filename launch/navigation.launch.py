"""The reconstruction with parameters for costmaps, and the head's place on the robot; Nav2 itself starts elsewhere.

Give Nav2 config/nav2_voxel_layer.yaml, nav2_obstacle_layer.yaml or stvl_layer.yaml of this package.
"""

from ament_index_python.packages import get_package_share_path
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource


def generate_launch_description():
    """The arguments of both included files can be given here too."""
    share = get_package_share_path("moire_sensor")
    sources = [
        PythonLaunchDescriptionSource(str(share / "launch" / name))
        for name in ("reconstruction.launch.py", "description.launch.py")
    ]
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "parameters",
                default_value=str(share / "config" / "navigation.yaml"),
                description="parameter file of the reconstruction",
            ),
            DeclareLaunchArgument(
                "base_frame", default_value="base_link", description="frame of the robot that carries the head"
            ),
            *(IncludeLaunchDescription(source) for source in sources),
        ]
    )
