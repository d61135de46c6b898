"""The simulator: scenes, layer laws, effects, and the world of patches that send what they feel."""

from skinbus.sim.scene import Scene
from skinbus.sim.scene_file import load_scene, scene_names
from skinbus.sim.touch import Touch, Touches
from skinbus.sim.world import World

__all__ = ["Scene", "Touch", "Touches", "World", "load_scene", "scene_names"]
