"""What stops a robot when its skin is touched too hard: a core that watches, and the stops that it does."""
