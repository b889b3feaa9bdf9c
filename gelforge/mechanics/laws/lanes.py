"""A number type of compiled functions: the same quantity of several elements, in the lanes of vector registers.

Arithmetic of lanes is that of LLVM's vectors, so that it needs no loop that a compiler may or may not vectorise. Code is
written as for floats: + - * / **, abs, min, max and the functions of `math` below take lanes, and a float next to lanes is
the same in all of them. What lanes cannot do is branch: `where_less` chooses instead.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any

from llvmlite import binding, ir
from numba.core import cgutils, types
from numba.core.typeconv import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, lower_cast, models, register_model

# Elements side by side. More than a register holds: where one result waits for another, the next registers' do not.
LANES = 8
# Lanes of one register, for sums that need all of the registers (AVX-512 has 32 of 8 numbers, AVX 16 of 4).
PART = 8 if binding.get_host_cpu_features().get("avx512f") else 4
PARTS = LANES // PART

FAST = {"contract", "nsz", "arcp"}  # sums keep their order: exp and log depend on it
# Of what is compiled by itself, which is sooner done than as lines of every loop, and then becomes a part of the loops.
ONCE: dict[str, Any] = {
    "forceinline": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True, "fastmath": FAST, "error_model": "numpy",
}  # fmt: skip

# Of exp on [-ln 2 / 2, ln 2 / 2] from the square on.
EXP_TERMS = [1.0 / math.factorial(k) for k in range(2, 14)]
# Of log, right to 2^-58 (Sun Microsystems 1993, e_log.c of fdlibm).
LOG_TERMS = (
    6.666666666666735130e-01, 3.999999999940941908e-01, 2.857142874366239149e-01, 2.222219843214978396e-01,
    1.818357216161805012e-01, 1.531383769920937332e-01, 1.479819860511658591e-01,
)  # fmt: skip
# ln 2 in two parts; times an exponent the first has no rounding (Sun Microsystems 1993, e_log.c of fdlibm).
LN2_HIGH, LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
# Bits of a double (IEEE 754-2019): those of its fraction, of 1 and of the root of 1/2.
MANTISSA, ONE, ROOT_HALF = 0xFFFFFFFFFFFFF, 0x3FF0000000000000, 0x3FE6A09E667F3BCD

_DOUBLE, _LONG, _INT = ir.DoubleType(), ir.IntType(64), ir.IntType(32)


class Lanes(types.Type):
    """`count` float64, one for each of as many elements."""

    def __init__(self, count: int):
        self.count = count
        super().__init__(name=f"Lanes({count})")

    def can_convert_from(self, typingctx, other):
        return Conversion.safe if isinstance(other, (types.Float, types.Integer)) else None


lanes, part = Lanes(LANES), Lanes(PART)


@register_model(Lanes)
class _Model(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, ir.VectorType(_DOUBLE, kind.count))


def _constant(like, value):
    """Return a number in all lanes of a vector type, or of the type of a vector."""
    kind = getattr(like, "type", like)
    return ir.Constant(kind, [value] * kind.count)


def _integers(x, kind=_LONG):
    return ir.VectorType(kind, x.type.count)


def _splat(builder, kind, value):
    one = builder.insert_element(ir.Constant(kind, ir.Undefined), value, _INT(0))
    return builder.shuffle_vector(one, one, ir.Constant(ir.VectorType(_INT, kind.count), [0] * kind.count))


def _joined(builder, vectors):
    """Return vectors one after the other as one."""
    joined = vectors[0]
    for other in vectors[1:]:
        order = ir.VectorType(_INT, joined.type.count + other.type.count)
        joined = builder.shuffle_vector(joined, other, ir.Constant(order, list(range(order.count))))
    return joined


def _call(builder, name: str, *arguments):
    kind = arguments[0].type
    function = ir.FunctionType(kind, [kind] * len(arguments))
    name = f"llvm.{name}.v{kind.count}f64"
    return builder.call(cgutils.get_or_insert_function(builder.module, function, name), arguments)


@lower_cast(types.Float, Lanes)
@lower_cast(types.Integer, Lanes)
def _of_number(context, builder, from_type, to_type, value):
    one = context.cast(builder, value, from_type, types.float64)
    return _splat(builder, context.get_value_type(to_type), one)


def _widest(given):
    return max((kind for kind in given if isinstance(kind, Lanes)), key=lambda kind: kind.count, default=None)


def _of_lanes(function, count: int, lower) -> None:
    """Let a function take lanes, or lanes and numbers, `count` in all, and return lanes; lower writes it."""

    class Typing(AbstractTemplate):
        def generic(self, given, keywords):
            kind = _widest(given)
            if kind is not None and len(given) == count:
                return signature(kind, *[kind] * count)

    infer_global(function)(Typing)
    lower_builtin(function, *[Lanes] * count)(lower)


def _at_once(functions, count: int, emit) -> None:
    """Let functions take lanes: emit(builder, *values) returns those of the result."""
    for function in functions:
        _of_lanes(function, count, lambda context, builder, sig, values: emit(builder, *values))


def _lane_by_lane(function, count: int) -> None:
    """Let a function take lanes by itself for every lane: as slow as without lanes."""

    def lower(context, builder, sig, values):
        scalar = context.get_function(function, signature(types.float64, *[types.float64] * count))
        result = ir.Constant(values[0].type, ir.Undefined)
        for lane in map(_INT, range(result.type.count)):
            one = scalar(builder, [builder.extract_element(value, lane) for value in values])
            result = builder.insert_element(result, one, lane)
        return result

    _of_lanes(function, count, lower)


def _exp(b, x):
    """e^x to an ulp: 2^n e^r, |r| <= ln 2 / 2."""
    x = b.select(b.fcmp_ordered(">", x, _constant(x, 800.0)), _constant(x, 800.0), x)
    x = b.select(b.fcmp_ordered("<", x, _constant(x, -800.0)), _constant(x, -800.0), x)
    n = _call(b, "rint", b.fmul(x, _constant(x, 1.0 / math.log(2.0))))
    r = _call(b, "fmuladd", n, _constant(x, -LN2_HIGH), x)
    r = _call(b, "fmuladd", n, _constant(x, -LN2_LOW), r)
    y = _call(b, "fmuladd", b.fmul(r, r), _horner(b, r, EXP_TERMS), r)
    y = b.fadd(y, _constant(y, 1.0))
    n = b.fptosi(n, _integers(x, _INT))
    # In two parts: each leaves a double where the result is subnormal or the largest
    half = b.ashr(n, _constant(n, 1))
    long, shift = _integers(x), _constant(_integers(x), 52)
    y = b.bitcast(b.add(b.bitcast(y, long), b.shl(b.sext(half, long), shift)), x.type)
    rest = b.sext(b.add(b.sub(n, half), _constant(n, 1023)), long)
    return b.fmul(y, b.bitcast(b.shl(rest, shift), x.type))


def _horner(b, x, terms):
    result = _constant(x, terms[-1])
    for term in reversed(terms[:-1]):
        result = _call(b, "fmuladd", result, x, _constant(x, term))
    return result


def _log(b, x):
    """ln x to two ulp: x = 2^k (1 + f) with 1 + f between the roots of 1/2 and 2, a series in s = f / (2 + f)."""
    small = b.fcmp_ordered("<", x, _constant(x, 2.0**-1022))
    bits = b.bitcast(b.select(small, b.fmul(x, _constant(x, 2.0**54)), x), _integers(x))
    bits = b.add(bits, _constant(bits, ONE - ROOT_HALF))
    k = b.sitofp(b.trunc(b.lshr(bits, _constant(bits, 52)), _integers(x, _INT)), x.type)
    k = b.fsub(k, b.select(small, _constant(x, 1023.0 + 54.0), _constant(x, 1023.0)))
    f = b.add(b.and_(bits, _constant(bits, MANTISSA)), _constant(bits, ROOT_HALF))
    f = b.fsub(b.bitcast(f, x.type), _constant(x, 1.0))
    s = b.fdiv(f, b.fadd(f, _constant(x, 2.0)))
    z = b.fmul(s, s)
    half = b.fmul(_constant(x, 0.5), b.fmul(f, f))
    rest = b.fmul(s, _call(b, "fmuladd", z, _horner(b, z, LOG_TERMS), half))
    rest = _call(b, "fmuladd", k, _constant(x, LN2_LOW), rest)
    y = _call(b, "fmuladd", k, _constant(x, LN2_HIGH), b.fsub(f, b.fsub(half, rest)))
    y = b.select(b.fcmp_ordered("<", x, _constant(x, math.inf)), y, x)
    none = b.select(
        b.fcmp_ordered("==", x, _constant(x, 0.0)), _constant(x, -math.inf), _constant(x, math.nan)
    )
    return b.select(b.fcmp_ordered(">", x, _constant(x, 0.0)), y, none)


_at_once((operator.add, operator.iadd), 2, lambda b, x, y: b.fadd(x, y))
_at_once((operator.sub, operator.isub), 2, lambda b, x, y: b.fsub(x, y))
_at_once((operator.mul, operator.imul), 2, lambda b, x, y: b.fmul(x, y))
_at_once((operator.truediv, operator.itruediv), 2, lambda b, x, y: b.fdiv(x, y))
_at_once((operator.neg,), 1, lambda b, x: b.fneg(x))
_at_once((abs,), 1, lambda b, x: _call(b, "fabs", x))
_at_once((min,), 2, lambda b, x, y: b.select(b.fcmp_ordered("<", y, x), y, x))
_at_once((max,), 2, lambda b, x, y: b.select(b.fcmp_ordered(">", y, x), y, x))
_at_once((math.sqrt,), 1, lambda b, x: _call(b, "sqrt", x))
_at_once((math.exp,), 1, _exp)
_at_once((math.log,), 1, _log)


for _name in "erf expm1 log1p sin cos tan atan sinh cosh tanh".split():
    _lane_by_lane(getattr(math, _name), 1)
_lane_by_lane(operator.pow, 2)


def _written(typed: Callable[..., Any]) -> Callable[..., Any]:
    """Return the function of compiled code that typed(typing context, *types) types and writes."""
    return intrinsic(typed)


@_written
def where_less(typingctx, x, y, then, otherwise):
    """Return `then` in the lanes where x < y, `otherwise` in the rest."""

    def lower(context, builder, sig, values):
        x, y, then, otherwise = values
        return builder.select(builder.fcmp_ordered("<", x, y), then, otherwise)

    kind = _widest((x, y, then, otherwise))
    return kind(kind, kind, kind, kind), lower


@_written
def any_less(typingctx, x, y):
    """Return whether x < y in a lane."""

    def lower(context, builder, sig, values):
        mask = ir.IntType(sig.args[0].count)
        return builder.icmp_unsigned("!=", builder.bitcast(builder.fcmp_ordered("<", *values), mask), mask(0))

    kind = _widest((x, y))
    return types.boolean(kind, kind), lower


def _places(context, builder, kind, array, k):
    """Return where the k-th vectors of a room lie, one in each of its parts."""
    room = context.make_array(kind)(context, builder, array)
    data = builder.bitcast(room.data, ir.VectorType(_DOUBLE, PART).as_pointer())
    if kind.ndim == 1:
        return [builder.gep(data, [k])]
    length = builder.udiv(cgutils.unpack_tuple(builder, room.shape, 2)[1], _LONG(PART))
    return [builder.gep(data, [builder.add(k, builder.mul(length, _LONG(p)))]) for p in range(PARTS)]


@_written
def load(typingctx, room, k):
    """Return the k-th lanes of a room (PARTS, n) float64; of one of its parts (n,) the k-th PART of them."""

    def lower(context, builder, sig, values):
        places = _places(context, builder, sig.args[0], *values)
        return _joined(builder, [builder.load(place, align=8 * PART) for place in places])

    return (lanes if room.ndim == 2 else part)(room, types.intp), lower


@_written
def store(typingctx, room, k, x):
    """Set the k-th lanes of a room (PARTS, n) float64; of one of its parts (n,) the k-th PART of them."""

    def lower(context, builder, sig, values):
        x = values[2]
        for p, place in enumerate(_places(context, builder, sig.args[0], *values[:2])):
            order = ir.Constant(ir.VectorType(_INT, PART), list(range(p * PART, (p + 1) * PART)))
            builder.store(builder.shuffle_vector(x, x, order), place, align=8 * PART)
        return context.get_dummy_value()

    return types.void(room, types.intp, lanes if room.ndim == 2 else part), lower


_STARTS = types.UniTuple(types.intp, LANES)


@_written
def take(typingctx, numbers, starts, k):
    """Return numbers[start + k] of an array (n,) float64, a lane for each of LANES starts."""

    def lower(context, builder, sig, values):
        array, starts, k = values
        data = builder.gep(context.make_array(sig.args[0])(context, builder, array).data, [k])
        result = ir.Constant(ir.VectorType(_DOUBLE, LANES), ir.Undefined)
        for lane in range(LANES):
            one = builder.load(builder.gep(data, [builder.extract_value(starts, lane)]))
            result = builder.insert_element(result, one, _INT(lane))
        return result

    return lanes(numbers, _STARTS, types.intp), lower


@_written
def starts_at(typingctx, numbers, starts, k, stride):
    """Return stride numbers[start + k] of an array (n,) of integers for each of LANES starts."""

    def lower(context, builder, sig, values):
        array, starts, k, stride = values
        kind = sig.args[0]
        data = builder.gep(context.make_array(kind)(context, builder, array).data, [k])
        result = ir.Constant(context.get_value_type(_STARTS), ir.Undefined)
        for lane in range(LANES):
            one = builder.load(builder.gep(data, [builder.extract_value(starts, lane)]))
            one = builder.mul(context.cast(builder, one, kind.dtype, types.intp), stride)
            result = builder.insert_value(result, one, lane)
        return result

    return _STARTS(numbers, _STARTS, types.intp, types.intp), lower


IN_ORDER = tuple(range(LANES))  # starts of numbers one after the other
