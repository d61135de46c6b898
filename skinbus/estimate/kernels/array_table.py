"""Tuples of arrays in kernels, handed on by address: a kernel that calls another copies two words, not 900.

numba passes a tuple by value: each call copies address, size, shape and strides of all its arrays, and the
callers of a small kernel spend more time on that than on its numbers. Here Python writes those words to a
table once; a kernel gets the address of the table and reads ``work.p`` from it where it is used.

Uncompiled, a handle is the tuple itself.
"""

from __future__ import annotations

import hashlib
from typing import Any, TypeVar

import numpy as np
from llvmlite import ir
from numba import config, typeof, types
from numba.core import cgutils
from numba.core.imputils import lower_getattr_generic
from numba.core.typing.templates import AttributeTemplate
from numba.extending import NativeValue, infer_getattr, models, register_model, unbox
from numba.np.arrayobj import make_array, populate_array

T = TypeVar("T", bound=tuple[Any, ...])
WORD = ir.IntType(64)


def array_table(arrays: T) -> T:
    """Return what kernels take instead of a named tuple of arrays; it keeps them alive.

    Raises:
        ValueError: an array is not C-contiguous.
    """
    if getattr(config, "DISABLE_JIT", 0):
        return arrays
    made: Any = ArrayTable(arrays)
    return made  # type: ignore[no-any-return]


class ArrayTable:
    """The table of a named tuple of arrays: for each its address and its shape."""

    def __init__(self, arrays: Any) -> None:
        words: list[int] = []
        places = []
        for name, array in arrays._asdict().items():
            if not array.flags.c_contiguous:
                raise ValueError(f"{type(arrays).__name__}.{name} must be C-contiguous")
            places.append((name, typeof(array), len(words)))
            words += [array.ctypes.data, *array.shape]
        self.arrays = arrays
        self.table = np.array(words, np.int64)
        self.address = int(self.table.ctypes.data)
        self._numba_type_ = ArrayTableType(type(arrays).__name__, tuple(places))

    def __reduce__(self) -> str:
        """Refuse to be copied: the copy would write to the arrays of the original."""
        raise TypeError("what kernels work on cannot be copied; make another Estimator")


class ArrayTableType(types.Type):
    """The type of a handle: ``places`` has name, type and first word of each array."""

    def __init__(self, of: str, places: tuple[tuple[str, Any, int], ...]) -> None:
        self.places = {name: (kind, word) for name, kind, word in places}
        digest = hashlib.sha256(repr(places).encode()).hexdigest()[:8]
        super().__init__(f"{of}_{digest}")  # short: the names of all kernels contain it


@register_model(ArrayTableType)
class ArrayTableModel(models.PrimitiveModel):
    """In memory: the address of the table."""

    def __init__(self, manager: Any, kind: ArrayTableType) -> None:
        super().__init__(manager, kind, WORD.as_pointer())


@infer_getattr
class ArrayTableAttributes(AttributeTemplate):
    """The fields of the tuple are attributes of its handle."""

    key = ArrayTableType

    def generic_resolve(self, kind: ArrayTableType, name: str) -> Any:  # type: ignore[override]
        return kind.places[name][0] if name in kind.places else None


@unbox(ArrayTableType)
def take_address(kind: ArrayTableType, value: Any, c: Any) -> NativeValue:
    """Read the address of a table from its handle in Python."""
    address = c.pyapi.object_getattr_string(value, "address")
    word = c.pyapi.long_as_longlong(address)
    c.pyapi.decref(address)
    return NativeValue(c.builder.inttoptr(word, WORD.as_pointer()))


@lower_getattr_generic(ArrayTableType)
def read_array(context: Any, builder: Any, kind: ArrayTableType, table: Any, name: str) -> Any:
    """Make an array of the words of a table, which do not change as long as there are kernels."""
    of, first = kind.places[name]
    constant = builder.module.add_metadata([])

    def word(i: int) -> Any:
        value = builder.load(builder.gep(table, [ir.IntType(32)(first + i)]))
        value.set_metadata("invariant.load", constant)
        return value

    item = context.get_abi_sizeof(context.get_data_type(of.dtype))
    shape = [word(1 + axis) for axis in range(of.ndim)]
    strides = [WORD(item)]
    for size in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], size))
    array = make_array(of)(context, builder)
    pointer = builder.inttoptr(word(0), context.get_data_type(of.dtype).as_pointer())
    populate_array(
        array,
        data=pointer,
        shape=cgutils.pack_array(builder, shape),
        strides=cgutils.pack_array(builder, strides),
        itemsize=WORD(item),
        meminfo=None,
    )
    return array._getvalue()
