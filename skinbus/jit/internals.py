"""What is private to numba, in one place: known to work with numba 0.61 to 0.68.

``KernelCache`` keeps kernels in ``skinbus.jit.kernel_files`` instead of numba's own files.
``ArrayTableType`` is how kernels read arrays from a table of addresses.
"""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable
from typing import Any, Final

import llvmlite
import numba
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.caching import _Cache
from numba.core.compiler import CompileResult
from numba.core.imputils import lower_getattr_generic
from numba.core.registry import cpu_target
from numba.core.serialize import dumps
from numba.core.typing.templates import AttributeTemplate
from numba.extending import NativeValue, infer_getattr, models, register_model, unbox

from skinbus.jit.kernel_files import KernelFolder, kernel_folder, shipped_kernels

ANY_PROCESSOR: Final = ("generic", "")
"""Name and features of the processor that NUMBA_CPU_NAME=generic compiles for: any of an architecture."""
WORD: Final = ir.IntType(64)


# --- Kernels on disk --------------------------------------------------------------------------------


def set_environments(result: Any) -> None:
    """Hand the environments of the inner kernels that a kernel contains to its code."""
    codegen = result.library.codegen
    for env in result._find_referenced_environments():
        if codegen._engine.is_symbol_defined(env.env_name):
            codegen.set_env(env.env_name, env)


class KernelCache(_Cache):
    """The entries of one kernel, by the types of its arguments."""

    def __init__(self, function: Callable[..., Any], stamp: str) -> None:
        self._kernel = f"{function.__module__}.{function.__qualname__}"
        self._stamp = stamp[:16]

    @property
    def cache_path(self) -> Any:
        return kernel_folder().path

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled kernel for a signature, None where it has to be compiled."""
        target_context.refresh()
        triple, *processor = target_context.codegen().magic_tuple()
        for folder, made_for in ((kernel_folder(), processor), (shipped_kernels(), ANY_PROCESSOR)):
            name = self._name(sig, (triple, *made_for))
            payload = folder.load(name)
            kernel = None if payload is None else _rebuild(folder, name, payload)
            if kernel is not None:
                return kernel
        return None

    def save_overload(self, sig: Any, cres: Any) -> None:
        set_environments(cres)
        if kernel_folder().path is not None and not cres.library.has_dynamic_globals:
            name = self._name(sig, cres.library.codegen.magic_tuple())
            kernel_folder().save(name, dumps(cres._reduce()))

    def enable(self) -> None:
        pass

    def disable(self) -> None:
        pass

    def flush(self) -> None:
        pass

    def _name(self, sig: Any, machine: tuple[str, ...]) -> str:
        flags: Any = numba.config
        options = flags.OPT, flags.BOUNDSCHECK, numba.__version__, llvmlite.__version__
        key = hashlib.sha256(repr((str(sig), machine, *map(str, options))).encode()).hexdigest()[:16]
        return f"{self._kernel}.{self._stamp}.{key}"


def _rebuild(folder: KernelFolder, name: str, payload: bytes, *, keep: bool = False) -> Any:
    """Return the kernel of an entry, None if it is no kernel; then the entry is removed.

    keep: one of other sources stays; it raises ImportError.
    """
    try:
        return CompileResult._rebuild(cpu_target.target_context, *pickle.loads(payload))
    except Exception as error:  # whatever is wrong with it: it can be made anew
        if keep and isinstance(error, ImportError):
            raise
        folder.discard(name, f"{type(error).__name__}: {error}")
        return None


def verify_entries() -> tuple[int, int]:
    """Load every entry on disk; return how many are sound, and how many were damaged and are not used.

    One that names a module that is not here is of another version of skinbus: it is neither.
    """
    sound, damaged = 0, 0
    cpu_target.target_context.refresh()
    for folder in (kernel_folder(), shipped_kernels()):
        for name in folder.names():
            payload = folder.load(name)
            try:
                is_sound = payload is not None and _rebuild(folder, name, payload, keep=True) is not None
            except ImportError:
                continue
            sound, damaged = sound + is_sound, damaged + (not is_sound)
    return sound, damaged


# --- Arrays by address ------------------------------------------------------------------------------


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
