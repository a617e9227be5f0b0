"""The reconstruction alone, for real cameras and a projector whose drivers publish elsewhere.

The topics of the drivers are arguments. Raw images are rectified by the node, from the camera infos; for those that
image_proc has rectified, say rectified:=true and name its image_rect topics.
"""

from ament_index_python.packages import get_package_share_path
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

INPUTS = {
    "left_image": "left/image_raw",
    "left_info": "left/camera_info",
    "right_image": "right/image_raw",
    "right_info": "right/camera_info",
    "projector_info": "projector/camera_info",
    "projector_state": "projector/state",
}


def generate_launch_description():
    """Sensor-data QoS: an image that comes late is worth nothing."""
    defaults = str(get_package_share_path("moire_sensor") / "config" / "reconstruction.yaml")
    return LaunchDescription(
        [
            DeclareLaunchArgument("namespace", default_value="head", description="namespace of the results"),
            DeclareLaunchArgument("parameters", default_value=defaults, description="parameter file of the node"),
            DeclareLaunchArgument("rectified", default_value="false", description="the images are rectified already"),
            *(
                DeclareLaunchArgument(name, default_value=topic, description=f"topic that stands for {topic}")
                for name, topic in INPUTS.items()
            ),
            Node(
                package="moire_sensor",
                executable="reconstruction",
                namespace=LaunchConfiguration("namespace"),
                parameters=[
                    LaunchConfiguration("parameters"),
                    {"input_rectified": ParameterValue(LaunchConfiguration("rectified"), value_type=bool)},
                ],
                remappings=[(topic, LaunchConfiguration(name)) for name, topic in INPUTS.items()],
                output="screen",
            ),
        ]
    )
