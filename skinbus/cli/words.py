"""Counts in words."""


def counted(n: int, thing: str) -> str:
    """Return n of a thing: 1 patch, 24 patches, 0 contacts."""
    if n == 1:
        return f"1 {thing}"
    return f"{n} {thing}{'es' if thing.endswith(('ch', 'ss')) else 's'}"
