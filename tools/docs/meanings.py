"""What topics, services, names and values mean; reference.py takes everything else from the code."""

from __future__ import annotations

from moire_sensor.shot import Status

TOPICS = {
    "left/image_raw": "left view, mono8 or mono16",
    "right/image_raw": "right view, mono8 or mono16, same stamp",
    "projector/state": "the fringes of this exposure, see below",
    "left/camera_info": "P is (3, 4), pixels and metres",
    "right/camera_info": "P[3] = -fx times the baseline, m",
    "projector/camera_info": "P maps the rectified left frame to undistorted projector pixels; K and D: its lens",
    "joint_states": "pan and tilt at the exposure's stamp, rad, rad/s",
    "joint_trajectory": "where to turn pan and tilt",
    "robot_description": "the URDF",
    "ground_truth/depth": "32FC1, z, m; only while subscribed to",
    "/diagnostics": "one status a concern: [the node](node.md#diagnostics)",
    "depth/image_rect": "z in the left frame: 32FC1, m, NaN unknown, or 16UC1, mm, 0 unknown (`depth_encoding`)",
    "depth/camera_info": "of the depth image and every other view here",
    "depth/sigma": "32FC1, predicted standard deviation of the depth, m",
    "confidence/image": "32FC1, 0 to 1: how likely the disparity is within a pixel of the truth",
    "status/image": "8UC1, see below",
    "fringe_order/image": "16SC1, projector period that the pixel sees, -32768 unknown",
    "background/image_rect": "mono8, the left view without fringes",
    "points": "organised, x y z intensity float32, m, NaN unknown",
    "points_nav": "one point a voxel that holds a surface, no NaN, m: [costmaps](navigation.md)",
    "points_nav_clearing": "ends of rays along which nothing stands, m: [costmaps](navigation.md)",
    "disparity": "pixels; T the baseline, m",
    "acquisition_done": "stamp of a whole set as it arrived: safe to move",
}
SERVICES = {
    "projector/enable": "fringes on or off; off gives views without fringes",
    "capture": "one exposure, or those of one result in phase steps, at once",
    "reconstruction/change_state": "lifecycle transitions: [the node](node.md#lifecycle)",
    "reconstruction/get_state": "the present lifecycle state",
    "reconstruction/get_available_states": "all lifecycle states",
    "reconstruction/get_available_transitions": "the transitions of the present state",
    "reconstruction/get_transition_graph": "all transitions",
}
STATE = {
    "format_version": "1",
    "fringe_period_px": "projector columns a fringe",
    "fringe_phase_rad": "phase at projector column 0 in this exposure, step included, rad",
    "step_index": "number of this exposure in its programme, from 0",
    "step_count": "exposures of one programme; 1 for a single shot",
    "waveform": "0 sine, 1 square",
    "laser_on": "0 or 1",
    "min_depth_m": "nearest depth that can occur, m",
    "max_depth_m": "farthest depth that can occur, m",
}
STATUS = {
    Status.OK: "depth from this pixel's own method",
    Status.UNLIT: "no fringes visible",
    Status.SATURATED: "too bright",
    Status.OCCLUDED: "no match that holds, as where only one camera sees the surface",
    Status.AMBIGUOUS: "left, right and projector do not fit each other; the whole image is refused",
    Status.MOVED: "moved too fast between the steps",
    Status.FROM_SINGLE_SHOT: "depth from one exposure where the steps do not serve",
}
