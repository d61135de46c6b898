"""The road backwards: scenes, the compliance layer, effects, simulated patches."""
