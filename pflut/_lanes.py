"""Eight float32 numbers at once, for kernels.

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

LANES = 8


def _eight(context: Any, builder: Any, array: Any, kind: Any, index: Any) -> Any:
    """Give the address of the eight numbers from an index on."""
    data = cgutils.create_struct_proxy(kind)(context, builder, array).data
    return builder.bitcast(
        builder.gep(data, [index]), ir.VectorType(ir.FloatType(), LANES).as_pointer()
    )


def _add_lanes(typing: Any, total: Any, at: Any, values: Any, start: Any) -> Any:
    """Give the type and the code of `add_lanes`."""
    signature = types.void(total, types.intp, values, types.intp)

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        target = _eight(context, builder, arguments[0], signature.args[0], arguments[1])
        source = _eight(context, builder, arguments[2], signature.args[2], arguments[3])
        added = builder.fadd(builder.load(target, align=4), builder.load(source, align=4))
        builder.store(added, target, align=4)
        return context.get_dummy_value()

    return signature, code


def _add_transposed(
    typing: Any, total: Any, at: Any, stride: Any, values: Any, start: Any, step: Any
) -> Any:
    """Give the type and the code of `add_transposed`."""
    signature = types.void(total, *[types.intp] * 2, values, *[types.intp] * 2)

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        total, at, stride, values, start, step = arguments

        def shuffled(a: Any, b: Any, order: list[int]) -> Any:
            mask = ir.Constant(ir.VectorType(ir.IntType(32), LANES), order)
            return builder.shuffle_vector(a, b, mask)

        rows = []
        for _ in range(LANES):
            place = _eight(context, builder, values, signature.args[3], start)
            rows.append(builder.load(place, align=4))
            start = builder.add(start, step)
        # three rounds of exchanging halves: of two, of four, of eight
        for half in (1, 2, 4):
            low = [i + (LANES - half if i & half else 0) for i in range(LANES)]
            high = [i + (LANES if i & half else half) for i in range(LANES)]
            for i in range(LANES):
                if not i & half:
                    a, b = rows[i], rows[i + half]
                    rows[i], rows[i + half] = shuffled(a, b, low), shuffled(a, b, high)
        for row in rows:
            place = _eight(context, builder, total, signature.args[0], at)
            builder.store(builder.fadd(builder.load(place, align=4), row), place, align=4)
            at = builder.add(at, stride)
        return context.get_dummy_value()

    return signature, code


if numba.config.DISABLE_JIT:

    def add_lanes(
        total: NDArray[np.float32], at: int, values: NDArray[np.float32], start: int
    ) -> None:
        """Add ``values[start : start + 8]`` to ``total[at : at + 8]``."""
        total[at : at + LANES] += values[start : start + LANES]

    def add_transposed(
        total: NDArray[np.float32],
        at: int,
        stride: int,
        values: NDArray[np.float32],
        start: int,
        step: int,
    ) -> None:
        """Add the transpose of eight rows of ``values``, ``step`` apart, to eight of ``total``."""
        for i in range(LANES):
            for j in range(LANES):
                total[at + i * stride + j] += values[start + j * step + i]

else:
    add_lanes = intrinsic(_add_lanes)
    add_transposed = intrinsic(_add_transposed)
