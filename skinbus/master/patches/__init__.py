"""The patches of a bus: state table, supervisor, passive monitor, provisioning."""
