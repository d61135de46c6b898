"""Compilers of kernels of a cycle, made of numba's own: private to numba, as ``internals`` is.

``CycleCompiler`` leaves out what numba does for code that kernels of a cycle do not contain, and looks up
once what they contain often. ``InnerCompiler`` also leaves a kernel that only kernels call as it was lowered:
numba would optimise it and make machine code of it, and then do both again with the copies in each of its
callers, and in theirs.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any, ClassVar

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.cpu import CPUContext
from numba.core.errors import TypingError
from numba.core.ir import UNDEFINED
from numba.core.lowering import Lower
from numba.core.typed_passes import NativeLowering
from numba.extending import models, register_model
from numba.np.arrayobj import load_item, store_item

WORD = ir.IntType(64)


UNUSED_PASSES = {
    "WithLifting",  # there are no `with` blocks,
    "InlineClosureLikes",  # closures or comprehensions,
    "MakeFunctionToJitFunction",
    "InlineInlinables",  # functions that are inlined before LLVM does it,
    "InlineOverloads",
    "FindLiterallyCalls",  # calls of `literally` and `literal_unroll`,
    "LiteralUnroll",
    "LiteralPropagationSubPipelinePass",
    "NopythonRewrites",  # expressions of whole arrays: they would allocate,
    "IRLegalization",  # references to be counted,
    "AnnotateTypes",  # and readers of the types of a kernel
    "DumpParforDiagnostics",
}


class MemoFunction(types.Function):
    """An operator or function of numba whose templates are tried once for each tuple of types.

    numba tries them, some thirty, at each place where an operator stands, and again when that is lowered.
    """

    def __init__(self, template: Any) -> None:
        super().__init__(template)
        self._known: dict[tuple[Any, ...], Any] = {}

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        """Return the signature of a call; raises TypingError if there is none."""
        if kws:
            return super().get_call_type(context, args, kws)
        key = tuple(args)
        known = self._known.get(key)
        if known is None:
            try:
                known = super().get_call_type(context, args, kws)
            except TypingError as error:
                known = error
            self._known[key] = known
        if isinstance(known, TypingError):
            raise known.with_traceback(None)
        return known


register_model(MemoFunction)(models.OpaqueModel)


class MemoTypingContext:
    """A typing context in which functions of numba are a :class:`MemoFunction`."""

    _functions: ClassVar[dict[Any, Any]] = {}

    def __init__(self, context: Any) -> None:
        self._context = context

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def _memo(self, kind: Any) -> Any:
        if type(kind) is not types.Function:
            return kind
        if kind not in self._functions:
            self._functions[kind] = MemoFunction(kind.templates)
        return self._functions[kind]

    def resolve_value_type(self, value: Any) -> Any:
        """Return the type of a constant or a global."""
        return self._memo(self._context.resolve_value_type(value))

    def resolve_value_type_prefer_literal(self, value: Any) -> Any:
        """Return the type of a constant or a global, that of its value where there is one."""
        return self._memo(self._context.resolve_value_type_prefer_literal(value))

    def resolve_getattr(self, kind: Any, name: str) -> Any:
        """Return the type of an attribute."""
        return self._memo(self._context.resolve_getattr(kind, name))

    def resolve_function_type(self, function: Any, args: Any, kws: Any) -> Any:
        """Return the signature of a call."""
        if isinstance(function, MemoFunction):
            return function.get_call_type(self._context, args, kws)
        return self._context.resolve_function_type(function, args, kws)

    def resolve_setitem(self, target: Any, index: Any, value: Any) -> Any:
        """Return the signature of the assignment to an item."""
        function = self.resolve_value_type(operator.setitem)
        return function.get_call_type(self._context, (target, index, value), {})


class MemoContext(CPUContext):
    """A target context that finds an implementation once in a kernel, and what is missing only once."""

    _missing: ClassVar[set[Any]] = set()
    _sizes: ClassVar[dict[Any, int]] = {}
    found: dict[Any, Any]
    """The implementations that the kernel uses."""

    def get_function(self, fn: Any, sig: Any, _firstcall: bool = True) -> Any:
        """Return the implementation of a function; raises NotImplementedError if there is none."""
        key = fn, sig
        if key in self._missing:
            raise NotImplementedError(f"no definition for lowering {fn}{sig}")
        if key not in self.found:
            try:
                self.found[key] = super().get_function(fn, sig, _firstcall)
            except NotImplementedError:
                if isinstance(fn, str):
                    self._missing.add(key)
                raise
        return self.found[key]

    def get_abi_sizeof(self, ty: Any) -> int:
        """Return the size of an LLVM type in bytes, which numba asks LLVM for by a module in text."""
        if ty not in self._sizes:
            self._sizes[ty] = super().get_abi_sizeof(ty)
        return self._sizes[ty]


class CycleLower(Lower):
    """Lowers in one step what stands most often in kernels: operators, and items of arrays.

    numba tries operators with constants first, also where there are none, and stores the description of an
    array in memory for each of its items.
    """

    def lower_binop(self, resty: Any, expr: Any, op: Any) -> Any:
        """Return the value of an operator."""
        if not (expr.static_lhs is expr.static_rhs is UNDEFINED):
            return super().lower_binop(resty, expr, op)
        function = self.context.typing_context.resolve_value_type(op)
        signature = self.fndesc.calltypes[expr]
        values = [
            self.context.cast(self.builder, self.loadvar(of.name), self.typeof(of.name), kind)
            for of, kind in zip((expr.lhs, expr.rhs), signature.args, strict=True)
        ]
        found = function.get_call_type(self.context.typing_context, signature.args, {})
        value = self.context.get_function(function, found)(self.builder, values)
        return self.context.cast(self.builder, value, signature.return_type, resty)

    def lower_getitem(self, resty: Any, expr: Any, value: Any, index: Any, signature: Any) -> Any:
        """Return an item of an array."""
        if not self._is_item(value, index):
            return super().lower_getitem(resty, expr, value, index, signature)
        kind = self.typeof(value.name)
        item = load_item(self.context, self.builder, kind, self._address(value, index))
        return self.context.cast(self.builder, item, signature.return_type, resty)

    def lower_setitem(self, target_var: Any, index_var: Any, value_var: Any, signature: Any) -> Any:
        """Write an item of an array."""
        if not self._is_item(target_var, index_var):
            return super().lower_setitem(target_var, index_var, value_var, signature)
        kind = self.typeof(target_var.name)
        value = self.context.cast(
            self.builder, self.loadvar(value_var.name), self.typeof(value_var.name), kind.dtype
        )
        return store_item(self.context, self.builder, kind, value, self._address(target_var, index_var))

    def _is_item(self, array: Any, index: Any) -> bool:
        """Return whether it is a number in an array without gaps, by one integer for each axis."""
        kind, kinds = self.typeof(array.name), _kinds_of(self.typeof(index.name))
        return (
            not self.context.enable_boundscheck
            and isinstance(kind, types.Array)
            and kind.layout == "C"
            and kind.ndim == len(kinds)
            and isinstance(kind.dtype, types.Number | types.Boolean)
            and all(isinstance(each, types.Integer) for each in kinds)
        )

    def _address(self, array: Any, index: Any) -> Any:
        """Return the address of an item.

        Indices below 0 do not count from the end, as in Python: no kernel has one, and each would be asked.
        """
        kind, value = self.typeof(array.name), self.loadvar(array.name)
        place = self.context.data_model_manager[kind].get_field_position
        kinds, indices = _kinds_of(self.typeof(index.name)), [self.loadvar(index.name)]
        if isinstance(self.typeof(index.name), types.BaseTuple):
            indices = cgutils.unpack_tuple(self.builder, indices[0])
        position = WORD(0)
        for axis, (of, at) in enumerate(zip(kinds, indices, strict=True)):
            size = self.builder.extract_value(value, [place("shape"), axis])
            at = self.context.cast(self.builder, at, of, types.intp)
            position = self.builder.add(self.builder.mul(position, size), at) if axis else at
        return self.builder.gep(self.builder.extract_value(value, place("data")), [position])


def _kinds_of(index: Any) -> Any:
    """Return the types of the parts of an index."""
    return tuple(index) if isinstance(index, types.BaseTuple) else (index,)  # type: ignore[arg-type]


@register_pass(mutates_CFG=True, analysis_only=False)
class CycleLowering(NativeLowering):
    """The pass that uses :class:`CycleLower`."""

    _name = "cycle_lowering"
    lowering_class = CycleLower


class CycleCompiler(Compiler):
    """numba's compiler for a kernel without memory of its own, without the passes that do nothing there."""

    def __init__(self, typingctx: Any, *args: Any) -> None:
        typing = MemoTypingContext(typingctx)
        super().__init__(typing, *args)
        target = self.state.targetctx  # a copy for this kernel
        target.__class__ = MemoContext
        target.typing_context, target.found = typing, {}

    def define_pipelines(self) -> list[Any]:
        (whole,) = super().define_pipelines()
        lean = PassManager(whole.pipeline_name)
        for run, what in whole.passes:
            is_repeated = any(run is other for other, _ in lean.passes)  # dead branches: none come later
            if run.__name__ not in UNUSED_PASSES and not is_repeated:
                lean.add_pass(CycleLowering if run is NativeLowering else run, what)
        lean.finalize()
        return [lean]


# --- Kernels that only kernels call -----------------------------------------------------------------


class InnerLibrary(JITCodeLibrary):
    """Code that is only linked into other code: neither optimised nor executable by itself."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return 0: there is no such function to be called from outside."""
        self._ensure_finalized()
        return 0

    @property
    def codegen(self) -> Any:
        return _WithoutEnvironments(self._codegen)


class _WithoutEnvironments:
    """A code generator for a library that is not loaded: it has no place for a function's environment."""

    def __init__(self, codegen: Any) -> None:
        self._codegen = codegen

    def __getattr__(self, name: str) -> Any:
        return getattr(self._codegen, name)

    def set_env(self, name: str, env: Any) -> None:
        """Leave it to ``KernelCache.save_overload``."""


class InnerCompiler(CycleCompiler):
    """The compiler of a cycle, writing to an :class:`InnerLibrary`."""

    def compile_extra(self, func: Callable[..., Any]) -> Any:
        self.state.library = InnerLibrary(self.state.targetctx.codegen(), func.__qualname__)
        return super().compile_extra(func)
