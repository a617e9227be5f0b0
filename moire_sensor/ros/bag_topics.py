"""What a bag holds: the head's topics, which alone give the same depth again, and the results."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import CameraInfo, Image, JointState, PointCloud2
from std_msgs.msg import Header, String
from stereo_msgs.msg import DisparityImage

from moire_sensor.errors import SettingsError


@dataclass(frozen=True)
class BagTopic:
    """One topic to record: its name relative to the head's namespace, and its message class.

    ``latched`` topics may be kept by their publisher for late subscribers; a topic without ``message`` takes the
    class of whoever publishes it. Both are subscribed to when a publisher is there, with the quality it offers.
    """

    name: str
    message: Any = None
    latched: bool = False


HEAD_TOPICS = (
    BagTopic("robot_description", String, latched=True),
    BagTopic("left/camera_info", CameraInfo, latched=True),
    BagTopic("right/camera_info", CameraInfo, latched=True),
    BagTopic("projector/camera_info", CameraInfo, latched=True),
    BagTopic("left/image_raw", Image),
    BagTopic("right/image_raw", Image),
    BagTopic("projector/state", JointState),
    BagTopic("joint_states", JointState),
)
RESULT_TOPICS = (
    BagTopic("depth/image_rect", Image),
    BagTopic("depth/camera_info", CameraInfo),
    BagTopic("depth/sigma", Image),
    BagTopic("confidence/image", Image),
    BagTopic("status/image", Image),
    BagTopic("fringe_order/image", Image),
    BagTopic("background/image_rect", Image),
    BagTopic("disparity", DisparityImage),
    BagTopic("points", PointCloud2),
    BagTopic("points_nav", PointCloud2),
    BagTopic("points_nav_clearing", PointCloud2),
    BagTopic("acquisition_done", Header),
    BagTopic("/diagnostics", DiagnosticArray),
)
GROUPS = {"head": HEAD_TOPICS, "results": RESULT_TOPICS}


def message_class(type_name: str) -> Any:
    """Return the class of a message type such as ``"sensor_msgs/msg/Image"``; raises SettingsError."""
    package, _, name = type_name.partition("/msg/")
    try:
        return getattr(import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError) as error:
        raise SettingsError(f"message type {type_name} is not installed; source the workspace that has it") from error


def type_name_of(message: Any) -> str:
    """Return the name of a message class, such as ``"sensor_msgs/msg/Image"``."""
    package, _, kind = message.__module__.partition(".")
    return f"{package}/{kind.partition('.')[0]}/{message.__name__}"


def topics_named(text: str) -> tuple[BagTopic, ...]:
    """Return the topics of names separated by spaces or commas; "head" and "results" name whole groups.

    Raises
    ------
    SettingsError
        No name at all.
    """
    names = text.replace(",", " ").split()
    if not names:
        raise SettingsError("parameter topics is empty; give topic names, head (the sensor's input) or results")
    known = {topic.name: topic for group in GROUPS.values() for topic in group}
    chosen: dict[str, BagTopic] = {}
    for name in names:
        for topic in GROUPS.get(name, (known.get(name, BagTopic(name)),)):
            chosen[topic.name] = topic
    return tuple(chosen.values())
