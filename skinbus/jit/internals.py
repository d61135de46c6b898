"""How kernels read arrays from a table of addresses; uses internals of numba 0.61 to 0.68."""

from __future__ import annotations

import hashlib
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.imputils import lower_getattr_generic
from numba.core.typing.templates import AttributeTemplate
from numba.extending import NativeValue, infer_getattr, models, register_model, unbox

WORD = ir.IntType(64)


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

    size = WORD(context.get_abi_sizeof(context.get_data_type(of.dtype)))
    shape = [word(1 + axis) for axis in range(of.ndim)]
    strides, items = [size], shape[0]
    for axis in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], axis))
        items = builder.mul(items, axis)
    pointer = builder.inttoptr(word(0), context.get_data_type(of.dtype).as_pointer())
    fields = {
        "nitems": items,
        "itemsize": size,
        "data": pointer,
        "shape": cgutils.pack_array(builder, shape),
        "strides": cgutils.pack_array(builder, strides),
    }
    array = ir.Constant(context.get_value_type(of), None)  # owned by nobody
    for field, value in fields.items():
        place = context.data_model_manager[of].get_field_position(field)
        array = builder.insert_value(array, value, place)
    return array
