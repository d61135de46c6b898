"""Counts and sets in words."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import groupby


def counted(n: int, thing: str) -> str:
    """Return n of a thing: 1 patch, 24 patches, 0 contacts, 2 touches."""
    if n == 1:
        return f"1 {thing}"
    return f"{n} {thing}{'es' if thing.endswith(('ch', 'ss')) else 's'}"


def span(numbers: Iterable[int]) -> str:
    """Return numbers as ranges: 1-4, 7."""
    runs = [
        [number for _, number in run]
        for _, run in groupby(enumerate(sorted(set(numbers))), lambda pair: pair[1] - pair[0])
    ]
    return ", ".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs)


def nodes(node_ids: Iterable[int]) -> str:
    """Return node-IDs with what they are: node 3, nodes 1-4, 7."""
    known = set(node_ids)
    return f"node{'' if len(known) == 1 else 's'} {span(known)}"
