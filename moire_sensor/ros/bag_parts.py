"""What metadata.yaml tells of a bag that is written in parts."""

from __future__ import annotations

from typing import Any, Literal

from rclpy.qos import QoSProfile
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

BAG_VERSION: Literal[9] = 9  # of ROS 2 Jazzy


def empty_information(storage: str) -> dict[str, Any]:
    """Return the metadata of a bag without any part."""
    return {
        "version": BAG_VERSION,
        "storage_identifier": storage,
        "relative_file_paths": [],
        "duration": {"nanoseconds": 0},
        "starting_time": {"nanoseconds_since_epoch": 0},
        "message_count": 0,
        "topics_with_message_count": [],
        "compression_format": "",
        "compression_mode": "",
        "files": [],
        "custom_data": None,
        "ros_distro": "rosbags",
    }


def merged(old: dict[str, Any], new: dict[str, Any]) -> dict[str, Any]:
    """Return the metadata of a bag of several parts: those so far, and one more."""
    files = [*old["files"], *new["files"]]
    spans = [
        (start := file["starting_time"]["nanoseconds_since_epoch"], start + file["duration"]["nanoseconds"])
        for file in files
    ]
    begin, end = min(start for start, _ in spans), max(end for _, end in spans)
    topics: dict[str, dict[str, Any]] = {}
    for entry in (*old["topics_with_message_count"], *new["topics_with_message_count"]):
        known = topics.setdefault(entry["topic_metadata"]["name"], {**entry, "message_count": 0})
        known["message_count"] += entry["message_count"]
    return {
        **old,
        "relative_file_paths": [*old["relative_file_paths"], *new["relative_file_paths"]],
        "files": files,
        "starting_time": {"nanoseconds_since_epoch": begin},
        "duration": {"nanoseconds": end - begin},
        "message_count": old["message_count"] + new["message_count"],
        "topics_with_message_count": list(topics.values()),
    }


def bag_quality(quality: QoSProfile) -> Qos:
    """Return an offered quality of service as the bag's metadata holds it."""
    durations = [
        QosTime(*divmod(duration.nanoseconds, 10**9))
        for duration in (quality.deadline, quality.lifespan, quality.liveliness_lease_duration)
    ]
    return Qos(
        history=QosHistory[quality.history.name],
        depth=quality.depth,
        reliability=QosReliability[quality.reliability.name],
        durability=QosDurability[quality.durability.name],
        deadline=durations[0],
        lifespan=durations[1],
        liveliness=QosLiveliness[quality.liveliness.name],
        liveliness_lease_duration=durations[2],
        avoid_ros_namespace_conventions=quality.avoid_ros_namespace_conventions,
    )
