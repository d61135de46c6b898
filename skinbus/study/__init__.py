"""What accuracy costs in time: estimates held against the truth."""
