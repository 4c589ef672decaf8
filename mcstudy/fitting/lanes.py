"""Eight starts side by side: a fixed-width vector of doubles for the compiled kernel.

A `Lanes` value holds the same quantity of eight independent fits. Every operation acts lane by lane, so a lane's
result depends on nothing in the other lanes, and the same bits come out whether the machine runs one lane
instruction as one AVX-512, two AVX2 or four SSE operations: the order of every sum is written down here, not left to
a vectoriser. Products followed by sums use a fused multiply-add, which IEEE 754 rounds once on every machine.

The functions work only inside numba-compiled code. ``array`` is a contiguous float64 workspace, or `registers`, and
``slot`` counts in lanes: slot k of a workspace is ``array[8 k : 8 k + 8]``.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, overload, register_model

WIDTH = 8
REGISTERS = 32
"""Lanes of a call's `registers`: a complex matrix of four rows."""

_VECTOR = ir.VectorType(ir.DoubleType(), WIDTH)


class Lanes(types.Type):
    """Numba type of eight doubles."""

    def __init__(self) -> None:
        super().__init__(name=f"Lanes{WIDTH}")


lanes = Lanes()


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: Any) -> None:
        super().__init__(dmm, fe_type, _VECTOR)


class Registers(types.Type):
    """Numba type of a few lanes that belong to one call of a function."""

    def __init__(self) -> None:
        super().__init__(name="Registers")


_registers = Registers()


@register_model(Registers)
class _RegistersModel(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: Any) -> None:
        super().__init__(dmm, fe_type, _VECTOR.as_pointer())


@intrinsic
def registers(_context: Any) -> Any:
    """Room for `REGISTERS` lanes, to `load` from and to `store` to.

    Where every slot is known when the function is compiled, the compiler keeps them in registers of the machine.
    """

    def code(_c: Any, builder: Any, _s: Any, _a: Any) -> Any:
        room = cgutils.alloca_once(builder, ir.ArrayType(_VECTOR, REGISTERS))
        return builder.bitcast(room, _VECTOR.as_pointer())

    return _registers(), code


def _pointer(context: Any, builder: Any, array_type: Any, array: Any, slot: Any) -> Any:
    if isinstance(array_type, Registers):
        return builder.gep(array, [slot])
    data = context.make_array(array_type)(context, builder, array).data
    first = builder.mul(slot, ir.Constant(slot.type, WIDTH))
    return builder.bitcast(builder.gep(data, [first]), _VECTOR.as_pointer())


@intrinsic
def load(_context: Any, array: Any, _slot: Any) -> Any:
    """The lanes in a workspace slot."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.load(_pointer(context, builder, signature.args[0], *args), align=8)

    return lanes(array, types.intp), code


@intrinsic
def store(_context: Any, array: Any, _slot: Any, value: Any) -> Any:
    """Write lanes to a workspace slot."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        builder.store(args[2], _pointer(context, builder, signature.args[0], *args[:2]), align=8)
        return context.get_dummy_value()

    return types.void(array, types.intp, value), code


@intrinsic
def splat(_context: Any, _value: Any) -> Any:
    """The same number in every lane."""

    def code(_c: Any, builder: Any, _s: Any, args: Any) -> Any:
        undefined = ir.Constant(_VECTOR, ir.Undefined)
        first = builder.insert_element(undefined, args[0], ir.Constant(ir.IntType(32), 0))
        zeros = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
        return builder.shuffle_vector(first, undefined, zeros)

    return lanes(types.float64), code


def _binary(name: str) -> Any:
    @intrinsic
    def operation(_context: Any, _x: Any, _y: Any) -> Any:
        def code(_c: Any, builder: Any, _s: Any, args: Any) -> Any:
            return getattr(builder, name)(*args)

        return lanes(lanes, lanes), code

    return operation


_add, _sub, _mul, _div = (_binary(name) for name in ("fadd", "fsub", "fmul", "fdiv"))


def _overload(symbol: Callable[..., Any], implementation: Any) -> None:
    @overload(symbol)
    def choose(x: Any, y: Any) -> Any:
        if isinstance(x, Lanes) and isinstance(y, Lanes):

            def apply(x: Any, y: Any) -> Any:  # numba wants the very signature of ``choose``
                return implementation(x, y)

            return apply
        return None


for _symbol, _implementation in (
    (operator.add, _add),
    (operator.sub, _sub),
    (operator.mul, _mul),
    (operator.truediv, _div),
):
    _overload(_symbol, _implementation)


def _llvm(name: str, n_args: int) -> Any:
    def call(builder: Any, args: Any) -> Any:
        kind = ir.FunctionType(_VECTOR, [_VECTOR] * n_args)
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{WIDTH}f64"), args)

    return call


@intrinsic
def fma(_context: Any, _x: Any, _y: Any, _z: Any) -> Any:
    """x * y + z, rounded once."""
    call = _llvm("fma", 3)

    def code(_c: Any, builder: Any, _s: Any, args: Any) -> Any:
        return call(builder, args)

    return lanes(lanes, lanes, lanes), code


@intrinsic
def fnma(_context: Any, _x: Any, _y: Any, _z: Any) -> Any:
    """z - x * y, rounded once."""
    call = _llvm("fma", 3)

    def code(_c: Any, builder: Any, _s: Any, args: Any) -> Any:
        return call(builder, [builder.fneg(args[0]), args[1], args[2]])

    return lanes(lanes, lanes, lanes), code


@intrinsic
def negative(_context: Any, _x: Any) -> Any:
    """-x."""

    def code(_c: Any, builder: Any, _s: Any, args: Any) -> Any:
        return builder.fneg(args[0])

    return lanes(lanes), code


@intrinsic
def nearest(_context: Any, _x: Any) -> Any:
    """Round to the nearest integer, ties to even."""
    call = _llvm("rint", 1)

    def code(_c: Any, builder: Any, _s: Any, args: Any) -> Any:
        return call(builder, args)

    return lanes(lanes), code


@intrinsic
def root(_context: Any, _x: Any) -> Any:
    """Square root, rounded once."""
    call = _llvm("sqrt", 1)

    def code(_c: Any, builder: Any, _s: Any, args: Any) -> Any:
        return call(builder, args)

    return lanes(lanes), code


@intrinsic
def where_less(_context: Any, _x: Any, _y: Any, _a: Any, _b: Any) -> Any:
    """``a`` in the lanes with x < y, else ``b`` (also where x or y is not a number)."""

    def code(_c: Any, builder: Any, _s: Any, args: Any) -> Any:
        return builder.select(builder.fcmp_ordered("<", args[0], args[1]), args[2], args[3])

    return lanes(lanes, lanes, lanes, lanes), code
