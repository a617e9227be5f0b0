"""A virtual fringe-projection head: fringe images of simulated scenes, with their truth.

Importing this package does not import pybullet; making a :class:`VirtualHead` does.
"""

from moire_sim.capture import HeadCapture
from moire_sim.errors import SceneError, SimulatorError
from moire_sim.fringe_image import Light
from moire_sim.head_options import HeadOptions, preset
from moire_sim.optics import Optics
from moire_sim.scenes import indoor_names, scene_names
from moire_sim.score import Score, score, score_depth
from moire_sim.virtual_head import VirtualHead

__all__ = [
    "HeadCapture",
    "HeadOptions",
    "Light",
    "Optics",
    "SceneError",
    "Score",
    "SimulatorError",
    "VirtualHead",
    "indoor_names",
    "preset",
    "scene_names",
    "score",
    "score_depth",
]
