"""Recordings for other tools: columns of what was on the bus, as Parquet and as MCAP."""
