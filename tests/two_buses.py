"""An arm file of one plate with a board on each of two buses; their node-IDs may repeat."""


def two_buses(*boards, names=("left", "right"), second=""):
    """Return TOML of boards (bus, node-ID, s in mm); ``second`` are keys of the second bus."""
    text = '[arm]\nname = "two buses"\nrate_hz = 50.0\n'
    for name, keys in zip(names, ("", second), strict=True):
        text += f'[[bus]]\nname = "{name}"\n{keys}\n'
    text += '[[link]]\nname = "plate"\nsurface = "plane"\nlength_mm = 110.0\nwidth_mm = 60.0\n'
    for bus, node_id, s_mm in boards:
        text += f'[[patch]]\nbus = "{bus}"\nnode_id = {node_id}\nlink = "plate"\ns_mm = {s_mm}\n'
    return text
