"""Files: TOML, arm file, mounting -> System (arm and dictionaries, read once)."""
