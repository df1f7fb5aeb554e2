"""What kernels need to say of memory that numba has no words for: arrays without counts, lines that are needed soon.

A kernel that calls others for every pixel spends more on counting references than on arithmetic: at each call numba
counts up and down what every array belongs to, with instructions that wait for the memory. What the caller of a kernel
holds for as long as that runs needs no counting within. And a kernel that goes from pixel to pixel in no order waits
for each of them, unless it asks for them some pixels ahead.
"""

from __future__ import annotations

from typing import Any, cast

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic


def _uncounted(typingctx: Any, value: Any) -> Any:
    """The array or tuple without reference counting, for use inside the kernel that got it as an argument."""

    def without_owner(context: Any, builder: Any, kind: Any, value: Any) -> Any:
        if isinstance(kind, types.Array):
            array = context.make_array(kind)(context, builder, value=value)
            for name in ("meminfo", "parent"):
                setattr(array, name, cgutils.get_null_value(getattr(array, name).type))
            return array._getvalue()
        if isinstance(kind, types.BaseTuple):
            for index, each in enumerate(cast("Any", kind)):
                part = builder.extract_value(value, index)
                value = builder.insert_value(value, without_owner(context, builder, each, part), index)
        return value

    return value(value), lambda context, builder, signature, args: without_owner(context, builder, value, args[0])


def _prefetch(typingctx: Any, array: Any, index: Any) -> Any:
    """Ask for the memory at a place of the first axis of an array; harmless for places that it does not have."""

    def ask(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        data = context.make_array(array)(context, builder, value=args[0])
        each = cgutils.unpack_tuple(builder, data.strides, array.ndim)[0]
        place = context.cast(builder, args[1], index, types.intp)
        byte, flag = cgutils.voidptr_t, cgutils.int32_t
        ir = cgutils.ir  # pyright: ignore[reportPrivateImportUsage] - llvmlite's, which is numba's own affair
        address = builder.gep(builder.bitcast(data.data, byte), [builder.mul(place, each)])
        kind = ir.FunctionType(ir.VoidType(), [byte, flag, flag, flag])
        called = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        builder.call(called, [address, flag(1), flag(3), flag(1)])  # to be written, kept in all caches, data
        return context.get_dummy_value()

    return types.void(array, index), ask


uncounted: Any = intrinsic(_uncounted)
prefetch: Any = intrinsic(_prefetch)
