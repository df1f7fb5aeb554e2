"""How one pixel turns intensity over time into events: the numba kernels under every simulated camera.

A pixel's life is a string of *ramps* (log intensity changes linearly between two instants) and *rests* (it is
constant). The first-order photoreceptor's answer to both is known in closed form. Over a ramp, which is at most a few
tenths of a pixel of motion, its output is taken as straight between the two ends and events are placed where that line
crosses a threshold; over a rest the crossing of the exponential itself is solved.

Kernels of one pixel take the rows of `PixelState` and of `EventBuffer`, whole arrays and no tuples of arrays: numba
counts references to every array of a tuple at every call, which cost more than the arithmetic.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, cast

import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from core.jit import njit
from core.simulation.sensor.sensor import (
    OFF_THRESHOLD,
    ON_THRESHOLD,
    RECEPTOR,
    REFERENCE,
    RELEASE_US,
    TARGET,
    TIME_US,
)


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


EVENT_TIME_US, EVENT_PIXEL, EVENT_ON = range(3)
SETTLED = 1e-6
"""A receptor this close to its target has arrived; 2e5 times less than a threshold."""
EVENTS_PER_PIXEL = 128
"""Room kept free in the buffer for each pixel of a substep; contrast 5 at the lowest threshold is 250 in a step, but
only of the few pixels of an edge."""
AHEAD = 16
"""A pixel is asked for from memory so many before its turn."""


class PixelTiming(NamedTuple):
    """How fast all pixels of a sensor answer."""

    photoreceptor_us: float
    """Time constant of the first-order photoreceptor; 0 for none."""
    refractory_us: float


class EventBuffer(NamedTuple):
    """What the kernels write events to."""

    rows: NDArray[np.float64]
    """(capacity, 3): time in microseconds, pixel index, 1 for ON; all exact."""
    filled: NDArray[np.int64]
    """(1,) how many rows hold an event."""

    @staticmethod
    def empty(capacity: int) -> EventBuffer:
        """Room for so many events."""
        return EventBuffer(np.empty((capacity, 3)), np.zeros(1, np.int64))

    def doubled(self) -> EventBuffer:
        """The events in a buffer of twice the size."""
        rows = np.empty((2 * len(self.rows), self.rows.shape[1]))  # memory that is not written to costs nothing
        rows[: self.filled[0]] = self.rows[: self.filled[0]]
        return EventBuffer(rows, self.filled)


@njit(error_model="numpy")
def receptor_decay(start_us, end_us, timing):
    """Share of the photoreceptor's lag that is left at `end_us`: exp(-duration / time constant)."""
    return math.exp((start_us - end_us) / timing.photoreceptor_us) if timing.photoreceptor_us > 0.0 else 0.0


@njit(error_model="numpy")
def rest_pixel(rows, pixel, end_us, timing, events, count):
    """Bring a pixel under constant intensity to `end_us`; returns the new event count."""
    tau_us, refractory_us = timing.photoreceptor_us, timing.refractory_us
    start_us = rows[pixel, TIME_US]
    if end_us <= start_us:
        return count
    goal = rows[pixel, TARGET]
    gap = rows[pixel, RECEPTOR] - goal
    rows[pixel, TIME_US] = end_us
    if abs(gap) <= SETTLED:
        rows[pixel, RECEPTOR] = goal
        gap = 0.0
    else:
        rows[pixel, RECEPTOR] = goal + gap * math.exp(-(end_us - start_us) / tau_us)
    ref = rows[pixel, REFERENCE]
    free_us = start_us
    if rows[pixel, RELEASE_US] > start_us:  # held in reset: it starts again from what it sees at the release
        free_us = rows[pixel, RELEASE_US]
        if free_us > end_us:
            return count
        ref = goal + (gap * math.exp(-(free_us - start_us) / tau_us) if gap != 0.0 else 0.0)
    while True:
        if goal - ref > rows[pixel, ON_THRESHOLD]:
            level, on = ref + rows[pixel, ON_THRESHOLD], True
        elif ref - goal > rows[pixel, OFF_THRESHOLD]:
            level, on = ref - rows[pixel, OFF_THRESHOLD], False
        else:
            break
        ratio = (level - goal) / gap if gap != 0.0 else 1.0
        crossing_us = start_us - tau_us * math.log(ratio) if 0.0 < ratio < 1.0 else free_us
        crossing_us = max(crossing_us, free_us)
        if crossing_us >= end_us:
            break
        events[count, EVENT_TIME_US] = crossing_us
        events[count, EVENT_PIXEL] = pixel
        events[count, EVENT_ON] = on
        count += 1
        ref = level
        if refractory_us > 0.0:
            free_us = crossing_us + refractory_us
            rows[pixel, RELEASE_US] = free_us
            if free_us > end_us:
                break
            ref = goal + (gap * math.exp(-(free_us - start_us) / tau_us) if gap != 0.0 else 0.0)
    rows[pixel, REFERENCE] = ref
    return count


@njit(error_model="numpy")
def receptor_after_ramp(before, goal, receptor, duration_us, tau_us, decay):
    """What the photoreceptor shows after its input went linearly from `before` to `goal`; decay is exp(-t / tau)."""
    lag = (goal - before) / duration_us * tau_us
    return goal - lag + (receptor - before + lag) * decay


@njit(error_model="numpy")
def ramp_pixel(rows, pixel, goal, end_us, decay, timing, events, count):
    """Take a pixel to `end_us` while its log intensity moves linearly to `goal`; returns the new event count.

    `decay` is `receptor_decay`, the same for most pixels of a step.
    """
    refractory_us = timing.refractory_us
    start_us = rows[pixel, TIME_US]
    before = rows[pixel, TARGET]
    v0 = rows[pixel, RECEPTOR]
    duration = end_us - start_us
    v1 = receptor_after_ramp(before, goal, v0, duration, timing.photoreceptor_us, decay)
    rows[pixel, TARGET] = goal
    rows[pixel, RECEPTOR] = v1
    rows[pixel, TIME_US] = end_us
    slope = (v1 - v0) / duration
    ref = rows[pixel, REFERENCE]
    if rows[pixel, RELEASE_US] > start_us:
        if rows[pixel, RELEASE_US] > end_us:
            return count
        ref = v0 + slope * (rows[pixel, RELEASE_US] - start_us)
    while True:
        if v1 - ref >= rows[pixel, ON_THRESHOLD]:
            level, on = ref + rows[pixel, ON_THRESHOLD], True
        elif ref - v1 >= rows[pixel, OFF_THRESHOLD]:
            level, on = ref - rows[pixel, OFF_THRESHOLD], False
        else:
            break
        # A reference outside [v0, v1] was overtaken between a release and now: it crosses at once.
        share = (level - v0) / (v1 - v0) if v1 != v0 else 1.0
        crossing_us = start_us + duration * min(max(share, 0.0), 1.0)
        crossing_us = max(crossing_us, rows[pixel, RELEASE_US])
        events[count, EVENT_TIME_US] = crossing_us
        events[count, EVENT_PIXEL] = pixel
        events[count, EVENT_ON] = on
        count += 1
        ref = level
        if refractory_us > 0.0:
            free_us = crossing_us + refractory_us
            rows[pixel, RELEASE_US] = free_us
            if free_us > end_us:
                break
            ref = v0 + slope * (free_us - start_us)
    rows[pixel, REFERENCE] = ref
    return count


@njit(inline="always", error_model="numpy")
def follow_pixel(rows, pixel, goal, now_us, decay, timing, events, count):
    """Like `ramp_pixel`, without the call where nothing happens.

    That is so most of the time, and the call would cost more than the arithmetic. It is written out in its callers.
    """
    start_us, tau_us = rows[pixel, TIME_US], timing.photoreceptor_us
    receptor = receptor_after_ramp(rows[pixel, TARGET], goal, rows[pixel, RECEPTOR], now_us - start_us, tau_us, decay)
    contrast = receptor - rows[pixel, REFERENCE]
    if rows[pixel, RELEASE_US] <= start_us and -rows[pixel, OFF_THRESHOLD] < contrast < rows[pixel, ON_THRESHOLD]:
        rows[pixel, TARGET] = goal
        rows[pixel, RECEPTOR] = receptor
        rows[pixel, TIME_US] = now_us
    else:
        count = ramp_pixel(rows, pixel, goal, now_us, decay, timing, events, count)
    return count


@njit(error_model="numpy")
def wake_pixel(pixels, pixel):
    """List a pixel that was at rest."""
    pixels.active[pixel] = True
    pixels.active_list[pixels.active_count[0]] = pixel
    pixels.active_count[0] += 1


@njit(error_model="numpy")
def settle_active(pixels, end_us, timing, events):
    """Bring every awake pixel to `end_us` and let those that have settled sleep.

    Returns false, and does nothing, if the buffer might overflow: call again with a larger one.
    """
    pixels, events = uncounted(pixels), uncounted(events)
    rows, active, active_list, event_rows = pixels.rows, pixels.active, pixels.active_list, events.rows
    count, kept = events.filled[0], 0
    if count + pixels.active_count[0] * EVENTS_PER_PIXEL > len(event_rows):
        return False
    last = pixels.active_count[0] - 1
    for place in range(last + 1):
        pixel = active_list[place]
        prefetch(rows, active_list[min(place + AHEAD, last)])
        count = rest_pixel(rows, pixel, end_us, timing, event_rows, count)
        if abs(rows[pixel, RECEPTOR] - rows[pixel, TARGET]) <= SETTLED and rows[pixel, RELEASE_US] <= end_us:
            rows[pixel, RECEPTOR] = rows[pixel, TARGET]
            active[pixel] = False
        else:
            active_list[kept] = pixel
            kept += 1
    events.filled[0], pixels.active_count[0] = count, kept
    return True
