"""A number for compiled code that is several numbers: the same quantity in :data:`LANES` runs, side by side.

numba's vectoriser gives up on bodies as long as a strapdown, so the vectors are spelled out: :data:`lane` is a numba
type of its own whose ``+ - * /`` and ``sqrt`` act on all lanes at once. The Python text of functions that take plain
numbers, and arrays of them, compiles for lanes as well; the filter's own mechanization runs on them unchanged.

``as_lanes`` looks at a float64 array of shape (..., LANES) as an array of lanes; it neither copies nor keeps the memory
alive. Lanes cannot be compared: ``if x < 1.0`` does not compile, since eight runs have eight answers. Text that is
shared with the engine and branches on a magnitude calls a helper that has a lane version (``_shared_kernels``).
``LaneBits`` are the lanes' 64-bit patterns, for random numbers and logarithms.
"""
# mypy: disallow-untyped-defs=False, disallow-incomplete-defs=False
# mypy: disallow-untyped-calls=False, check-untyped-defs=False

from __future__ import annotations

import math
import operator
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.compiler_lock import global_compiler_lock
from numba.core.imputils import lower_cast
from numba.core.typeconv.castgraph import Conversion
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

from schuler.jit import PLAIN

LANES = 8

_VECTOR = ir.VectorType(ir.DoubleType(), LANES)
_BITS = ir.VectorType(ir.IntType(64), LANES)
_FLAGS = ("contract",)  # as jit.kernel: fused multiply-add and nothing else


class LaneType(types.Type):
    """numba type of a lane vector."""

    def __init__(self):
        super().__init__(name=f"lane{LANES}")

    def can_convert_from(self, typingctx, other):
        """Plain numbers are the same in every lane."""
        return Conversion.safe if isinstance(other, types.Float | types.Integer) else None

    def unify(self, typingctx, other):
        """A variable that is a number on one path and lanes on another holds lanes."""
        return self if isinstance(other, types.Float | types.Integer) else None


class LaneBits(types.Type):
    """numba type of the bit patterns of a lane vector."""

    def __init__(self):
        super().__init__(name=f"lanebits{LANES}")


lane = LaneType()
bits = LaneBits()


@register_model(LaneType)
class _LaneModel(models.PrimitiveModel):
    def __init__(self, dmm, fe_type):
        super().__init__(dmm, fe_type, _VECTOR)


@register_model(LaneBits)
class _BitsModel(models.PrimitiveModel):
    def __init__(self, dmm, fe_type):
        super().__init__(dmm, fe_type, _BITS)


def _splat(builder, value, vector=_VECTOR):
    """The same scalar in every lane."""
    first = builder.insert_element(ir.Constant(vector, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(first, ir.Constant(vector, ir.Undefined), zeros)


def _constant(value):
    return ir.Constant(_BITS, [value] * LANES)


@lower_cast(types.Float, LaneType)
@lower_cast(types.Integer, LaneType)
def _from_number(context, builder, fromty, toty, val):
    return _splat(builder, context.cast(builder, val, fromty, types.float64))


# ------------------------------------------------------------------------------------------- arithmetic

_BINARY = [
    signature(lane, lane, lane),
    signature(lane, lane, types.float64),
    signature(lane, types.float64, lane),
    signature(lane, lane, types.int64),
    signature(lane, types.int64, lane),
]
_UNARY = [signature(lane, lane)]


def _declare(function, signatures):
    """Tell numba that a function or operator takes lanes."""

    class Template(ConcreteTemplate):
        key = function
        cases = signatures

    with global_compiler_lock:  # never in the middle of another thread's compilation, which may use the operator
        infer_global(function)(Template)


def _define(op, emit):
    _declare(op, _BINARY)

    def lower(context, builder, sig, args):
        x, y = (context.cast(builder, v, t, lane) for v, t in zip(args, sig.args, strict=True))
        return getattr(builder, emit)(x, y, flags=_FLAGS)

    for case in _BINARY:
        lower_builtin(op, *case.args)(lower)


for _operators, _emit in (
    ((operator.add, operator.iadd), "fadd"),
    ((operator.sub, operator.isub), "fsub"),
    ((operator.mul, operator.imul), "fmul"),
    ((operator.truediv, operator.itruediv), "fdiv"),
):
    for _operator in _operators:
        _define(_operator, _emit)


_declare(operator.neg, _UNARY)


@lower_builtin(operator.neg, lane)
def _negative(context, builder, sig, args):
    return builder.fneg(args[0])


def _unary(function, name):
    _declare(function, _UNARY)

    def lower(context, builder, sig, args):
        f = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(_VECTOR, [_VECTOR]), f"llvm.{name}.v{LANES}f64"
        )
        return builder.call(f, args)

    lower_builtin(function, lane)(lower)


_unary(math.sqrt, "sqrt")

# ----------------------------------------------------------------------------------- by lane, and memory


@intrinsic
def where_at_most(typingctx, x, limit, yes, no):
    """``yes`` in the lanes where ``x <= limit``, ``no`` in the others (also where x is NaN)."""

    def codegen(context, builder, sig, args):
        x, limit, yes, no = args
        return builder.select(builder.fcmp_ordered("<=", x, limit), yes, no)

    return lane(lane, lane, lane, lane), codegen


def _borrowed(context, builder, result, pointer, shape):
    """Array of lanes on memory that belongs to somebody else."""
    array = context.make_array(result)(context, builder)
    size = context.get_constant(types.intp, 8 * LANES)
    strides, count = [], context.get_constant(types.intp, 1)
    for n in reversed(shape):
        strides.insert(0, builder.mul(count, size))
        count = builder.mul(count, n)
    array.data = builder.bitcast(pointer, _VECTOR.as_pointer())
    array.shape = cgutils.pack_array(builder, shape)
    array.strides = cgutils.pack_array(builder, strides)
    array.itemsize = size
    array.nitems = count
    array.meminfo = cgutils.get_null_value(array.meminfo.type)
    array.parent = cgutils.get_null_value(array.parent.type)
    return array._getvalue()


@intrinsic
def _borrowed_lanes(typingctx, array):
    """A C-contiguous float64 array of shape (..., LANES) as an array of lanes; the memory is borrowed."""
    result = types.Array(lane, array.ndim - 1, "C", aligned=False)

    def codegen(context, builder, sig, args):
        source = context.make_array(array)(context, builder, args[0])
        shape = cgutils.unpack_tuple(builder, source.shape)[:-1]
        return _borrowed(context, builder, result, source.data, shape)

    return result(array), codegen


def _rows(array):
    """The array itself: in plain Python a lane is a row of it."""
    return array


as_lanes: Any = _rows if PLAIN else _borrowed_lanes  # random numbers in lanes need the compiler


@intrinsic
def cut(typingctx, array, first, shape):
    """Rows of a float64 array of shape (k, LANES) from ``first`` on as an array of lanes of a shape (a tuple)."""
    result = types.Array(lane, len(shape), "C", aligned=False)

    def codegen(context, builder, sig, args):
        source = context.make_array(array)(context, builder, args[0])
        row = context.cast(builder, args[1], first, types.intp)
        pointer = builder.gep(source.data, [builder.mul(row, row.type(LANES))])
        sizes = [
            context.cast(builder, n, t, types.intp)
            for n, t in zip(cgutils.unpack_tuple(builder, args[2]), shape, strict=True)
        ]
        return _borrowed(context, builder, result, pointer, sizes)

    return result(array, first, shape), codegen


# ------------------------------------------------------------------------------------------------- bits


@intrinsic
def load_bits(typingctx, array, i):
    """Row ``i`` of a uint64 array of shape (k, LANES)."""

    def codegen(context, builder, sig, args):
        return builder.load(_row(context, builder, array, *args), align=8)

    return bits(array, i), codegen


@intrinsic
def store_bits(typingctx, array, i, x):
    """Write row ``i`` of a uint64 array of shape (k, LANES)."""

    def codegen(context, builder, sig, args):
        builder.store(args[2], _row(context, builder, array, args[0], args[1]), align=8)
        return context.get_dummy_value()

    return types.void(array, i, x), codegen


def _row(context, builder, array, value, i):
    data = context.make_array(array)(context, builder, value).data
    return builder.bitcast(builder.gep(data, [builder.mul(i, i.type(LANES))]), _BITS.as_pointer())


@intrinsic
def add_bits(typingctx, x, y):
    """Sum modulo 2^64."""
    return bits(bits, bits), lambda context, builder, sig, args: builder.add(*args)


@intrinsic
def xor_bits(typingctx, x, y):
    """Exclusive or."""
    return bits(bits, bits), lambda context, builder, sig, args: builder.xor(*args)


@intrinsic(prefer_literal=True)
def shift_left(typingctx, x, k):
    """Bits moved up by a literal number of places."""
    n = k.literal_value
    return bits(bits, k), lambda context, builder, sig, args: builder.shl(args[0], _constant(n))


@intrinsic(prefer_literal=True)
def rotate_left(typingctx, x, k):
    """Bits moved round by a literal number of places."""
    n = k.literal_value

    def codegen(context, builder, sig, args):
        return builder.or_(builder.shl(args[0], _constant(n)), builder.lshr(args[0], _constant(64 - n)))

    return bits(bits, k), codegen


@intrinsic
def one_to_two(typingctx, x):
    """The number 1 <= y < 2 whose 52 places are the upper 52 bits: uniform if the bits are."""

    def codegen(context, builder, sig, args):
        pattern = builder.or_(builder.lshr(args[0], _constant(12)), _constant(0x3FF0000000000000))
        return builder.bitcast(pattern, _VECTOR)

    return lane(bits), codegen


@intrinsic
def split_power(typingctx, x):
    """Positive normal numbers as ``m 2**e`` with ``sqrt(1/2) <= m < sqrt(2)``; returns m, e."""

    def codegen(context, builder, sig, args):
        pattern = builder.bitcast(args[0], _BITS)
        root_half = 0x3FE6A09E667F3BCD
        e = builder.ashr(builder.sub(pattern, _constant(root_half)), _constant(52))
        m = builder.bitcast(builder.sub(pattern, builder.shl(e, _constant(52))), _VECTOR)
        return context.make_tuple(builder, sig.return_type, (m, builder.sitofp(e, _VECTOR)))

    return types.UniTuple(lane, 2)(lane), codegen


@intrinsic(prefer_literal=True)
def swap_by_bit(typingctx, x, k, a, b):
    """``a, b``, or ``b, a`` in the lanes where the literal bit ``k`` of x is set."""
    n = k.literal_value

    def codegen(context, builder, sig, args):
        x, _, a, b = args
        mask = builder.icmp_unsigned("!=", builder.and_(x, _constant(1 << n)), _constant(0))
        return context.make_tuple(builder, sig.return_type, (builder.select(mask, b, a), builder.select(mask, a, b)))

    return types.UniTuple(lane, 2)(bits, k, lane, lane), codegen


@intrinsic(prefer_literal=True)
def negate_by_bit(typingctx, x, k, a):
    """``a``, with its sign changed in the lanes where the literal bit ``k`` of x is set."""
    n = k.literal_value

    def codegen(context, builder, sig, args):
        x, _, a = args
        sign = builder.and_(builder.shl(x, _constant(63 - n)), _constant(1 << 63))
        return builder.bitcast(builder.xor(builder.bitcast(a, _BITS), sign), _VECTOR)

    return lane(bits, k, lane), codegen
