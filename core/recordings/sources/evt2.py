"""Prophesee EVT2 (32-bit words, one event each) and EVT2.1 (64-bit words, up to 32 pixels of a row each).

Source: Prophesee's EVT2 and EVT2.1 format descriptions. Events outside the sensor are left out and counted.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from core.jit import njit
from core.recordings.sources.evt_time import (
    BAD_TIME,
    IGNORE,
    NO_DAMAGE,
    STOP,
    TIME_HIGH,
    judge_time_high,
    next_time_high,
)

EVENT_OFF: Final = 0x0
EVENT_ON: Final = 0x1
EXT_TRIGGER: Final = 0xA

_SECOND: Final = 1_000_000 // 64
_MASK: Final = 0xFFFFFFF
_SUSPECT_WORDS: Final = 4096
_HIGH, _EPOCH, _LAST_T, _IGNORED, _OUTSIDE, _MAX_X, _MAX_Y = 0, 2, 6, 7, 9, 10, 11
PLAIN, JUMP, LOST = range(3)
"""Steps of the coarse time."""


def start_state_evt2(words: np.ndarray) -> np.ndarray:
    """The state in front of the first word of an EVT2 file."""
    return _start_state(int(next_time_high(words, 0, 28, 0, _MASK)))


def start_state_evt21(words: np.ndarray) -> np.ndarray:
    """The state in front of the first word of an EVT2.1 file."""
    return _start_state(int(next_time_high(words, 0, 60, 32, _MASK)))


def _start_state(first: int) -> np.ndarray:
    state = np.zeros(12, np.int64)
    state[_HIGH] = first if first > 1 else 0
    state[_LAST_T] = np.iinfo(np.int64).min
    return state


@njit
def _step_time(words, i, value, state, type_shift, value_shift):
    """Take in a coarse time; returns PLAIN, JUMP, or LOST at the end of what can be trusted."""
    high = state[_HIGH]
    if value == high:
        return PLAIN
    verdict = judge_time_high(words, i, value, high, type_shift, value_shift, _MASK, _SECOND)
    if verdict == STOP:
        return LOST
    if verdict == IGNORE:
        state[_IGNORED] += 1
        return PLAIN
    if value < high:
        state[_EPOCH] += 1 << 34
    state[_HIGH] = value
    return JUMP if ((value - high) & _MASK) > _SECOND else PLAIN


@njit
def decode_evt2(words, state, width, height, out):
    """Decode EVT2 words as `decode_evt3` does its own: returns (words used, events, triggers, damage)."""
    t, x, y, on, trigger_t, trigger_on, trigger_id = out
    last_t = state[_LAST_T]
    base_t = state[_EPOCH] + (state[_HIGH] << 6)
    events, triggers, damage = 0, 0, NO_DAMAGE
    jump_word, jump_events, jump_triggers = -_SUSPECT_WORDS, 0, 0
    room, trigger_room = len(t), len(trigger_t)
    i = 0
    while i < len(words) and events < room and triggers < trigger_room:
        word = np.int64(words[i])
        kind = word >> 28
        if kind in (EVENT_OFF, EVENT_ON):
            column, row = (word >> 11) & 0x7FF, word & 0x7FF
            last_t = max(last_t, base_t + ((word >> 22) & 0x3F))
            if column >= width or row >= height:
                state[_OUTSIDE] += 1
                state[_MAX_X], state[_MAX_Y] = max(state[_MAX_X], column), max(state[_MAX_Y], row)
            else:
                t[events], x[events], y[events], on[events] = last_t, column, row, kind
                events += 1
        elif kind == TIME_HIGH:
            step = _step_time(words, i, word & _MASK, state, 28, 0)
            if step == LOST:
                damage = BAD_TIME
                break
            if step == JUMP:
                jump_word, jump_events, jump_triggers = i, events, triggers
            base_t = state[_EPOCH] + (state[_HIGH] << 6)
        elif kind == EXT_TRIGGER:
            last_t = max(last_t, base_t + ((word >> 22) & 0x3F))
            trigger_t[triggers], trigger_on[triggers], trigger_id[triggers] = last_t, word & 1, (word >> 8) & 0x1F
            triggers += 1
        i += 1  # other words carry what events do not need: monitoring, vendor data
    if damage and i - jump_word < _SUSPECT_WORDS:
        events, triggers = jump_events, jump_triggers
    state[_LAST_T] = last_t
    return i, events, triggers, damage


@njit
def decode_evt21(words, state, width, height, out):
    """Decode EVT2.1 words as `decode_evt3` does its own: returns (words used, events, triggers, damage)."""
    t, x, y, on, trigger_t, trigger_on, trigger_id = out
    last_t = state[_LAST_T]
    base_t = state[_EPOCH] + (state[_HIGH] << 6)
    events, triggers, damage = 0, 0, NO_DAMAGE
    jump_word, jump_events, jump_triggers = -_SUSPECT_WORDS, 0, 0
    room, trigger_room = len(t) - 32, len(trigger_t)
    i = 0
    while i < len(words) and events <= room and triggers < trigger_room:
        word = words[i]
        kind = np.int64(word >> np.uint64(60))
        upper = np.int64((word >> np.uint64(32)) & np.uint64(_MASK))
        if kind in (EVENT_OFF, EVENT_ON):
            column, row = (upper >> 11) & 0x7FF, upper & 0x7FF
            pixels = np.int64(word & np.uint64(0xFFFFFFFF))
            last_t = max(last_t, base_t + (upper >> 22))
            while pixels:
                if pixels & 1:
                    if column >= width or row >= height:
                        state[_OUTSIDE] += 1
                        state[_MAX_X], state[_MAX_Y] = max(state[_MAX_X], column), max(state[_MAX_Y], row)
                    else:
                        t[events], x[events], y[events], on[events] = last_t, column, row, kind
                        events += 1
                pixels >>= 1
                column += 1
        elif kind == TIME_HIGH:
            step = _step_time(words, i, upper, state, 60, 32)
            if step == LOST:
                damage = BAD_TIME
                break
            if step == JUMP:
                jump_word, jump_events, jump_triggers = i, events, triggers
            base_t = state[_EPOCH] + (state[_HIGH] << 6)
        elif kind == EXT_TRIGGER:
            last_t = max(last_t, base_t + (upper >> 22))
            trigger_t[triggers], trigger_on[triggers], trigger_id[triggers] = last_t, upper & 1, (upper >> 8) & 0x1F
            triggers += 1
        i += 1
    if damage and i - jump_word < _SUSPECT_WORDS:
        events, triggers = jump_events, jump_triggers
    state[_LAST_T] = last_t
    return i, events, triggers, damage
