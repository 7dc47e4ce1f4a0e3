"""numba's compiler, quicker while it compiles our kernels: answers that it looks for again and again are kept.

Nothing here changes the code that comes out, but for the loops that are not unrolled where that is wanted. What another
numba keeps elsewhere stays as that numba has it.
"""

from __future__ import annotations

import contextlib
import gc
import types
from collections.abc import Callable, Iterable, Iterator
from typing import Any, cast

import llvmlite.binding
import llvmlite.ir
import numba
import numba.core.codegen

_core: Any = numba.core
_NEVER_A_CONSTANT = (types.ModuleType, types.BuiltinFunctionType, types.FunctionType, type)


@contextlib.contextmanager
def quick_compilation(unrolled: bool) -> Iterator[None]:
    """Compile with answers kept, without a search for cycles, and without unrolled loops if that is wanted.

    Shares of the time that the filter takes to compile: the type of ``a * b``, for which numba tries every
    implementation wherever it stands, a tenth; Python's search for cycles among the millions of objects that are made
    meanwhile, and soon freed, a sixth; variables of instructions, types of functions and modules, sizes of types and
    registries together a seventh.
    """
    with _core.compiler_lock.global_compiler_lock, _without_cycle_search(), contextlib.ExitStack() as stack:
        for owner, name, quicker in _quicker(unrolled):
            slower = vars(owner).get(name)
            if slower is not None:
                setattr(owner, name, quicker(slower))
                stack.callback(setattr, owner, name, slower)
        yield


def _quicker(unrolled: bool) -> Iterator[tuple[Any, str, Callable[[Any], Any]]]:
    """Object, name of its function, and what makes that function quicker."""
    yield _core.types.functions.BaseFunction, "get_call_type", _calls_typed_once
    for kind in (_core.ir.Inst, _core.ir.Stmt, _core.ir.Expr):
        yield kind, "_rec_list_vars" if kind is _core.ir.Inst else "list_vars", _LISTS[kind.__name__]
    yield _core.typing.context, "typeof", _functions_refused_once
    for kind in (_core.cpu.CPUContext, _core.typing.context.Context):
        yield kind, "load_additional_registries", _registries_loaded_once
    for name in ("get_abi_size", "get_abi_alignment"):
        yield llvmlite.ir.Type, name, _measured_once
    if not unrolled:
        yield _core.codegen, "create_pass_builder", _passes_without_unrolling


@contextlib.contextmanager
def _without_cycle_search() -> Iterator[None]:
    """Python's garbage collector switched off, and on again if it was on."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


def _calls_typed_once(resolve: Callable[..., Any]) -> Callable[..., Any]:
    """Type of an operation, looked up once for each types of its operands."""

    def call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
        if kws:
            return resolve(self, context, args, kws)
        resolved = self.__dict__.setdefault("_signatures_of_operands", {})
        key = (context, tuple(args))
        if key not in resolved:
            resolved[key] = resolve(self, context, args, kws)
        return resolved[key]

    return call_type


def _functions_refused_once(typeof: Callable[..., Any]) -> Callable[..., Any]:
    """Type of a constant; modules and functions that have none are refused without trying everything again."""
    refused: dict[int, Any] = {}  # with the value, so that nothing else gets its identity

    def type_of(value: Any, *purpose: Any) -> Any:
        if id(value) in refused:
            raise ValueError(f"no numba type of {value}")
        try:
            return typeof(value, *purpose)
        except ValueError:
            if isinstance(value, _NEVER_A_CONSTANT):
                refused[id(value)] = value
            raise

    return type_of


def _registries_loaded_once(load: Callable[[Any], None]) -> Callable[[Any], None]:
    """Registries of implementations in other modules, which numba loads again whenever it misses one."""
    loaded: list[Any] = []

    def load_once(self: Any) -> None:
        if not any(self is other for other in loaded):
            load(self)
            loaded.append(self)

    return load_once


def _measured_once(measure: Callable[..., int]) -> Callable[..., int]:
    """Size or alignment of a type, for which llvmlite has a module parsed each time."""
    sizes: dict[tuple[Any, ...], int] = {}

    def measured(self: Any, target: Any, context: Any = None) -> int:
        key = (str(self), target, context)
        if key not in sizes:
            sizes[key] = measure(self, target, context)
        return sizes[key]

    return measured


def _passes_without_unrolling(_: Callable[..., Any]) -> Callable[..., Any]:
    """LLVM's passes as numba asks for them, but for the unrolling of loops."""

    def passes(target: Any, opt: int = 2, loop_vectorize: bool = False, slp_vectorize: bool = False) -> Any:
        options = cast(Any, llvmlite.binding).create_pipeline_tuning_options(opt)
        options.loop_vectorization, options.slp_vectorization = loop_vectorize, slp_vectorize
        options.loop_unrolling = False
        return cast(Any, llvmlite.binding).create_pass_builder(target, options)

    return passes


def _add_variables(values: Iterable[Any], variables: list[Any]) -> None:
    """Append the variables among values and in what they hold, in order."""
    for value in values:
        what = _holds.get(value.__class__)
        if what is None:
            what = _holds[value.__class__] = _kind(value)
        if what == "variable":
            variables.append(value)
        elif what == "instruction":
            variables.extend(value.list_vars())
        elif what == "sequence":
            _add_variables(value, variables)
        elif what == "mapping":
            _add_variables(value.values(), variables)


_holds: dict[type, str] = {}  # what an object of a class holds, for _add_variables


def _kind(value: Any) -> str:
    for what, kinds in (
        ("variable", _core.ir.Var),
        ("instruction", _core.ir.Inst),
        ("sequence", (list, tuple)),
        ("mapping", dict),
    ):
        if isinstance(value, kinds):
            return what
    return "nothing"


def _variables(values: Iterable[Any]) -> list[Any]:
    variables: list[Any] = []
    _add_variables(values, variables)
    return variables


# lists of variables, without a question about its kind to every object on the way
_LISTS: dict[str, Callable[[Any], Any]] = {
    "Inst": lambda _: lambda self, value: _variables((value,)),
    "Stmt": lambda _: lambda self: _variables(vars(self).values()),
    "Expr": lambda _: lambda self: _variables(self._kws.values()),
}
