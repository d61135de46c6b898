"""Columns that kernels work on, made from the named tuple that declares them."""

from __future__ import annotations

from typing import Any, TypeVar, get_args, get_type_hints

import numpy as np

T = TypeVar("T", bound=tuple[Any, ...])


def filled(kind: type[T], n: int, others: dict[str, int], **given: Any) -> T:
    """Return columns of a kind as they are given, the rest zeros (n,), or as long as ``others`` has them.

    Raises:
        TypeError: a column is given that the kind does not have.
    """
    zeros = {
        name: np.zeros(others.get(name, n), _scalar(hint))
        for name, hint in get_type_hints(kind).items()
        if name not in given
    }
    return kind(**zeros, **given)


def _scalar(hint: Any) -> Any:
    """Return np.float64 of NDArray[np.float64]: the last of shape and dtype, since numpy 2.5 all there is."""
    while args := get_args(hint):
        hint = args[-1]
    return hint
