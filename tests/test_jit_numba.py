"""Laws of the quicker compilation: the same code as numba's own, and nothing left behind."""

from __future__ import annotations

import llvmlite.binding
import llvmlite.ir
import numba
import pytest
from numba.core import compiler, ir
from numba.core.typing import context

from schuler import jit
from schuler.jit_numba import quick_compilation


def test_what_users_compile_is_compiled_as_numba_does():
    """The quicker compilation ends with each kernel, also where one cannot be compiled."""
    import numba.core.codegen
    from numba.core.types.functions import BaseFunction

    def parts():
        builder = getattr(numba.core.codegen, "create_pass_builder", "unrolled")  # numba 0.61.2 has none
        return builder, BaseFunction.get_call_type

    before = parts()
    inside = []

    @jit.over_states
    def doubled(x):
        return 2.0 * x

    for unrolled in (False, True):
        with quick_compilation(unrolled):
            inside.append(parts())
    assert not (set(inside[0]) & set(before)) - {"unrolled"}
    assert (inside[1][0] is before[0], inside[1][1] is before[1]) == (True, False)
    assert doubled(1.5) == 3.0
    assert parts() == before

    @jit.kernel
    def impossible(x):
        return x.nothing

    with pytest.raises(numba.core.errors.TypingError):
        impossible(1.5)
    assert parts() == before


def _text(x, pairs):
    total = 0.0
    for i, (a, b) in enumerate(pairs):
        if i in (1, 2) or a > x[i, 0]:
            x[i, 1:] = a
        total += min(a, b, x[i, 0] * 2.0)
    return total, [x + 1 for x in pairs], {"a": total}


def test_instructions_have_the_variables_that_numba_lists():
    statements = [s for block in compiler.run_frontend(_text).blocks.values() for s in block.body]
    values = [s.value for s in statements if isinstance(s, ir.Assign) and isinstance(s.value, ir.Expr)]

    def variables():
        return [s.list_vars() for s in (*statements, *values)], values[0]._rec_list_vars([values, {"b": statements}, 3])

    expected = variables()
    with quick_compilation(unrolled=False):
        assert variables() == expected
    assert {len(v) for v in expected[0]} > {0, 1, 2, 3}


def test_types_have_the_sizes_that_llvm_gives_them():
    double, byte = llvmlite.ir.DoubleType(), llvmlite.ir.IntType(8)
    kinds = [double, byte, llvmlite.ir.LiteralStructType([byte, double]), llvmlite.ir.ArrayType(byte, 3)]
    target = numba.core.registry.cpu_target.target_context.codegen().target_data

    def sizes():
        return [(t.get_abi_size(target), t.get_abi_alignment(target)) for t in (*kinds, *kinds)]

    with quick_compilation(unrolled=False):
        assert sizes() == [(8, 8), (1, 1), (16, 8), (3, 1)] * 2


def test_constants_have_the_types_that_numba_gives_them():
    """A function has none, the second time neither; what has one is never refused for what was refused before."""
    typing = numba.core.registry.cpu_target.typing_context
    typing.refresh()
    values = (1.5, 2, _text, len, pytest, (1, 2.0), abs, float, numba.float64, None)

    def types():
        return [typing.resolve_value_type(v) if v is not _text and v is not pytest else _refused(v) for v in values]

    def _refused(value):
        with pytest.raises(ValueError, match="type"):
            context.typeof(value, context.Purpose.constant)
        return "refused"

    expected = types()
    with quick_compilation(unrolled=False):
        assert types() == expected
        assert types() == expected


def test_a_kernel_apart_compiles_where_llvm_takes_no_attributes_of_functions(monkeypatch):
    """With llvmlite up to 0.47 they become those of the function's value, and the module is refused."""

    @jit.apart
    def squared(x):
        return x * x

    def caller():
        @jit.borrowing
        def twice(x):
            return squared(x) + squared(x)

        return twice

    assert caller()(3.0) == 18.0
    monkeypatch.setattr(jit, "_functions_take_attributes", lambda: False)
    assert caller()(3) == 18  # another type: compiled anew
