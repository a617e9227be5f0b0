"""Two virtual heads at once, each with its reconstruction: own namespaces and frames, projectors by turns."""

from ament_index_python.packages import get_package_share_path
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, GroupAction, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration

# Namespace and share of the period at which the head has its turn.
HEADS = {"left_head": "0.0", "right_head": "0.5"}
SHARED = {
    "scene": ("room", "what both heads look at"),
    "rate_hz": ("5.0", "exposures per second of each head"),
    "method": ("dense", "dense or phase_shift"),
}


def generate_launch_description():
    """One demo a head; each group keeps its arguments to itself."""
    demo = str(get_package_share_path("moire_sensor") / "launch" / "demo.launch.py")
    shared = [(name, LaunchConfiguration(name)) for name in SHARED]
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=text)
                for name, (default, text) in SHARED.items()
            ),
            *(
                GroupAction(
                    [
                        IncludeLaunchDescription(
                            PythonLaunchDescriptionSource(demo),
                            launch_arguments=[
                                ("namespace", name),
                                ("frame_prefix", f"{name}/"),
                                ("start_offset", offset),
                                *shared,
                            ],
                        )
                    ],
                    forwarding=True,
                    scoped=True,
                )
                for name, offset in HEADS.items()
            ),
        ]
    )
