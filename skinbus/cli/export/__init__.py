"""Recordings as tables and as files of other tools: what `skinbus export` writes."""
