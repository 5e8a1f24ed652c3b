"""Many numbers at once, for kernels: of 16 bits to add up, of 32 to give out.

LLVM vectorises a loop only where it can prove that what is read and what is written do not overlap,
which it cannot of two places found by look-ups. As with `_trig`, whoever edits this file deletes
Numba's cache.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic
from numpy.typing import NDArray

LANES = 16
"""Numbers of 16 bits in a register; half as many of 32."""
HALF = LANES // 2
SHORTS = ir.VectorType(ir.IntType(16), LANES)
HALF_SHORTS = ir.VectorType(ir.IntType(16), HALF)
FLOATS = ir.VectorType(ir.FloatType(), HALF)


def _at(context: Any, builder: Any, array: Any, kind: Any, index: Any, vector: Any) -> Any:
    """Give the address of the numbers from an index on."""
    data = cgutils.create_struct_proxy(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), vector.as_pointer())


def _splat(builder: Any, value: Any) -> Any:
    """Give a vector that holds a float32 in all its lanes."""
    one = builder.insert_element(ir.Constant(FLOATS, ir.Undefined), value, ir.IntType(32)(0))
    order = ir.Constant(ir.VectorType(ir.IntType(32), HALF), [0] * HALF)
    return builder.shuffle_vector(one, one, order)


def _add_lanes(typing: Any, total: Any, at: Any, values: Any, start: Any) -> Any:
    """Give the type and the code of `add_lanes`."""
    signature = types.void(total, types.intp, values, types.intp)

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        target = _at(context, builder, arguments[0], signature.args[0], arguments[1], SHORTS)
        source = _at(context, builder, arguments[2], signature.args[2], arguments[3], SHORTS)
        added = builder.add(builder.load(target, align=2), builder.load(source, align=2))
        builder.store(added, target, align=2)
        return context.get_dummy_value()

    return signature, code


def _add_shares(
    typing: Any, total: Any, at: Any, values: Any, start: Any, shares: Any, first: Any
) -> Any:
    """Give the type and the code of `add_shares`."""
    signature = types.void(total, types.intp, values, types.intp, shares, types.intp)

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        total, at, values, start, shares, first = arguments
        target = _at(context, builder, total, signature.args[0], at, SHORTS)
        source = _at(context, builder, values, signature.args[2], start, SHORTS)
        share = _at(context, builder, shares, signature.args[4], first, SHORTS)
        # the higher half of a product of 32 bits
        wide = ir.VectorType(ir.IntType(32), LANES)
        factors = [builder.zext(builder.load(p, align=2), wide) for p in (source, share)]
        shift = ir.Constant(wide, [16] * LANES)
        part = builder.trunc(builder.lshr(builder.mul(*factors), shift), SHORTS)
        builder.store(builder.add(builder.load(target, align=2), part), target, align=2)
        return context.get_dummy_value()

    return signature, code


def _add_scaled(typing: Any, total: Any, at: Any, values: Any, start: Any, unit: Any) -> Any:
    """Give the type and the code of `add_scaled`."""
    signature = types.void(total, types.intp, values, types.intp, types.float32)

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        target = _at(context, builder, arguments[0], signature.args[0], arguments[1], FLOATS)
        source = _at(context, builder, arguments[2], signature.args[2], arguments[3], HALF_SHORTS)
        row = builder.uitofp(builder.load(source, align=2), FLOATS)
        scaled = builder.fmul(row, _splat(builder, arguments[4]))
        builder.store(builder.fadd(builder.load(target, align=4), scaled), target, align=4)
        return context.get_dummy_value()

    return signature, code


def _add_transposed(
    typing: Any, total: Any, at: Any, stride: Any, values: Any, start: Any, step: Any, unit: Any
) -> Any:
    """Give the type and the code of `add_transposed`."""
    whole = [types.intp] * 2
    signature = types.void(total, *whole, values, *whole, types.float32)

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        total, at, stride, values, start, step, unit = arguments

        def shuffled(a: Any, b: Any, order: list[int]) -> Any:
            mask = ir.Constant(ir.VectorType(ir.IntType(32), HALF), order)
            return builder.shuffle_vector(a, b, mask)

        rows = []
        for _ in range(HALF):
            place = _at(context, builder, values, signature.args[3], start, HALF_SHORTS)
            rows.append(builder.load(place, align=2))
            start = builder.add(start, step)
        # three rounds of exchanging halves: of two, of four, of eight
        for half in (1, 2, 4):
            low = [i + (HALF - half if i & half else 0) for i in range(HALF)]
            high = [i + (HALF if i & half else half) for i in range(HALF)]
            for i in range(HALF):
                if not i & half:
                    a, b = rows[i], rows[i + half]
                    rows[i], rows[i + half] = shuffled(a, b, low), shuffled(a, b, high)
        scale = _splat(builder, unit)
        for row in rows:
            place = _at(context, builder, total, signature.args[0], at, FLOATS)
            scaled = builder.fmul(builder.uitofp(row, FLOATS), scale)
            builder.store(builder.fadd(builder.load(place, align=4), scaled), place, align=4)
            at = builder.add(at, stride)
        return context.get_dummy_value()

    return signature, code


if numba.config.DISABLE_JIT:
    Shorts = NDArray[np.uint16]
    Floats = NDArray[np.float32]

    def add_lanes(total: Shorts, at: int, values: Shorts, start: int) -> None:
        """Add ``values[start : start + 16]`` to ``total[at : at + 16]``."""
        total[at : at + LANES] += values[start : start + LANES]

    def add_shares(
        total: Shorts, at: int, values: Shorts, start: int, shares: Shorts, first: int
    ) -> None:
        """Add ``values[start : start + 16]`` to ``total[at : at + 16]``, a share of each.

        ``shares[first : first + 16]``, in 1 / 65536.
        """
        share = shares[first : first + LANES].astype(np.uint32)
        total[at : at + LANES] += (values[start : start + LANES] * share >> 16).astype(np.uint16)

    def add_scaled(total: Floats, at: int, values: Shorts, start: int, unit: np.float32) -> None:
        """Add ``values[start : start + 8]``, in units of ``unit``, to ``total[at : at + 8]``."""
        total[at : at + HALF] += values[start : start + HALF] * unit

    def add_transposed(
        total: Floats, at: int, stride: int, values: Shorts, start: int, step: int, unit: np.float32
    ) -> None:
        """Add the transpose of eight rows of ``values``, ``step`` apart, to eight of ``total``."""
        for i in range(HALF):
            for j in range(HALF):
                total[at + i * stride + j] += values[start + j * step + i] * unit

else:
    add_lanes = intrinsic(_add_lanes)
    add_shares = intrinsic(_add_shares)
    add_scaled = intrinsic(_add_scaled)
    add_transposed = intrinsic(_add_transposed)
