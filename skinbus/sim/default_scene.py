"""The scene of an arm that has none: a fingertip presses some of its boards, one after the other."""

from __future__ import annotations

from typing import Any

import numpy as np

from skinbus.config.placement import keys_of
from skinbus.model import Arm

MOST = 5
"""Touches, on boards spread over the arm: as many as people watch."""

FORCE_N = 6.0
DIAMETER_MM = 12.0
"""Of a fingertip; a firm press."""

PRESS_S = 1.5
GAP_S = 0.5
"""Patches boot in the first pause, and what moves on the screen can be followed."""


def default_scene(arm: Arm) -> dict[str, Any]:
    """Return the document of a scene of an arm, as a TOML file would hold it."""
    n = min(MOST, arm.n_patches)
    patches = np.unique(np.linspace(0, arm.n_patches - 1, n).round().astype(int)).tolist()
    touches = []
    for k, p in enumerate(patches):
        placed = arm.patches[p]
        link = arm.links[placed.link]
        begin_s = GAP_S + k * (PRESS_S + GAP_S)
        touch = {
            "link": link.name,
            **keys_of(link.surface, placed.s, placed.a),
            "shape": "disc",
            "diameter_mm": DIAMETER_MM,
            "force_n": FORCE_N,
            "start_s": begin_s,
            "end_s": begin_s + PRESS_S,
        }
        touches.append(touch)
    duration_s = GAP_S + len(touches) * (PRESS_S + GAP_S)
    scene = {"title": f"a fingertip on {arm.name}", "arm": arm.name, "duration_s": duration_s}
    return {"scene": scene, "touch": touches, "effect": {"noise": {}}}
