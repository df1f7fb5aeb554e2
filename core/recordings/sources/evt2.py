"""Prophesee EVT2 (32-bit words, one event each) and EVT2.1 (64-bit words, up to 32 pixels of a row each).

Source: Prophesee's EVT2 and EVT2.1 format descriptions. Events outside the sensor are left out and counted.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from core.jit import njit
from core.recordings.sources.evt_time import (
    BAD_TIME,
    EVT2_TIME,
    EVT21_TIME,
    IGNORE,
    NO_DAMAGE,
    STOP,
    SUSPECT_WORDS,
    judge_time_high,
    next_time_high,
)

EVENT_OFF: Final = 0x0
EVENT_ON: Final = 0x1
TIME_HIGH: Final = 0x8
EXT_TRIGGER: Final = 0xA

_MASK: Final = EVT2_TIME.mask
_SECOND: Final = EVT2_TIME.second
_HIGH, _EPOCH, _LAST_T, _IGNORED, _RESERVED, _OUTSIDE, _MAX_X, _MAX_Y, LATE = 0, 2, 6, 7, 8, 9, 10, 11, 12
_NO_TYPE: Final = np.isin(np.arange(16), (EVENT_OFF, EVENT_ON, TIME_HIGH, EXT_TRIGGER, 0xE, 0xF), invert=True)
_RUN: Final = 256
"""Words of which a quarter are of no type where bytes were lost, and none behind."""
_BESIDE: Final = 16
"""Words on both sides of such a place that are left out: which of them are right cannot be told."""
PLAIN, JUMP, LOST = range(3)
"""Steps of the coarse time."""


def start_state_evt2(words: np.ndarray) -> np.ndarray:
    """The state in front of the first word of an EVT2 file."""
    return _start_state(int(next_time_high(words, 0, EVT2_TIME)))


def start_state_evt21(words: np.ndarray) -> np.ndarray:
    """The state in front of the first word of an EVT2.1 file."""
    return _start_state(int(next_time_high(words, 0, EVT21_TIME)))


def _start_state(first: int) -> np.ndarray:
    state = np.zeros(13, np.int64)
    state[_HIGH] = first if first > 1 else 0
    state[_LAST_T] = np.iinfo(np.int64).min
    return state


def realigned_evt2(data: bytes) -> tuple[bytes, int]:
    """Bytes of EVT2 with whole words again behind bytes that were lost or added, and how many are left out for that.

    There many words are of no type, and one to three bytes further none are and the coarse time goes on.
    """
    left_out, first = 0, 0
    while True:
        types = _top_bytes(data)
        if np.count_nonzero(_NO_TYPE[types[::8] >> 4]) <= _RUN // 64:  # nearly every file
            return data, left_out
        no_type = _NO_TYPE[types >> 4]
        odd = np.cumsum(no_type)[first:]
        many = np.flatnonzero(odd[_RUN:] - odd[:-_RUN] > _RUN // 4)
        if not len(many):
            return data, left_out
        word = first + int(np.searchsorted(odd, odd[many[0]], side="right"))  # the first of no type
        found = [cut for offset in (1, 2, 3) for cut in _next_aligned(data, word, offset)]
        if not found:
            return data, left_out
        start, end = found[0]
        data, left_out, first = data[:start] + data[end:], left_out + end - start, start // 4


def _top_bytes(data: bytes) -> np.ndarray:
    """Highest byte of each whole word; its upper half is the type."""
    return np.frombuffer(data, np.uint8, len(data) // 4 * 4)[3::4]


def _next_aligned(data: bytes, word: int, offset: int) -> list[tuple[int, int]]:
    """Which bytes to leave out round a `word` of no type, so that those `offset` bytes further are words; or none."""
    before = np.frombuffer(data, "<u4", word)
    high = before[_top_bytes(before.tobytes()) >> 4 == TIME_HIGH][-1:] & 0xFFFFFFF
    further = data[offset:]
    types = _top_bytes(further) >> 4
    run = types[word + _BESIDE : word + _BESIDE + _RUN]
    if len(run) < _RUN or _NO_TYPE[run].any() or not len(high):
        return []
    at = word + _BESIDE + np.flatnonzero(run == TIME_HIGH)[:1]
    following = np.frombuffer(further, "<u4", len(further) // 4)[at] & 0xFFFFFFF
    if not len(at) or not 0 <= int(following[0]) - int(high[0]) <= _SECOND:
        return []
    return [(max(0, word - _BESIDE) * 4, int(at[0]) * 4 + offset)]


@njit
def _step_time(words, i, value, state, form):
    """Take in a coarse time; returns PLAIN, JUMP, or LOST at the end of what can be trusted."""
    high = state[_HIGH]
    if value == high:
        return PLAIN
    verdict = judge_time_high(words, i, value, high, form)
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
def _is_padding(words, i):
    """Whether a word of zeros stands beside another one: no pixel has two events at one time."""
    return (i > 0 and words[i - 1] == 0) or (i + 1 < len(words) and words[i + 1] == 0)


@njit
def decode_evt2(words, state, width, height, out):
    """Decode EVT2 words as `decode_evt3` does its own: returns (words used, events, triggers, damage)."""
    t, x, y, on, trigger_t, trigger_on, trigger_id = out
    last_t = state[_LAST_T]
    base_t = state[_EPOCH] + (state[_HIGH] << 6)
    events, triggers, damage = 0, 0, NO_DAMAGE
    jump_word, jump_events, jump_triggers = -SUSPECT_WORDS, 0, 0
    room, trigger_room = len(t), len(trigger_t)
    i = 0
    while i < len(words) and events < room and triggers < trigger_room:
        word = np.int64(words[i])
        kind = word >> 28
        if word == 0 and _is_padding(words, i):
            state[_RESERVED] += 1
        elif kind in (EVENT_OFF, EVENT_ON):
            column, row = (word >> 11) & 0x7FF, word & 0x7FF
            now = base_t + ((word >> 22) & 0x3F)
            state[LATE] += now < last_t
            last_t = max(last_t, now)
            if column >= width or row >= height:
                state[_OUTSIDE] += 1
                state[_MAX_X], state[_MAX_Y] = max(state[_MAX_X], column), max(state[_MAX_Y], row)
            else:
                t[events], x[events], y[events], on[events] = last_t, column, row, kind
                events += 1
        elif kind == TIME_HIGH:
            step = _step_time(words, i, word & _MASK, state, EVT2_TIME)
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
    if damage and i - jump_word < SUSPECT_WORDS:
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
    jump_word, jump_events, jump_triggers = -SUSPECT_WORDS, 0, 0
    # One word holds up to 32 events.
    room, trigger_room = len(t) - 32, len(trigger_t)
    i = 0
    while i < len(words) and events <= room and triggers < trigger_room:
        word = words[i]
        kind = np.int64(word >> np.uint64(60))
        upper = np.int64((word >> np.uint64(32)) & np.uint64(_MASK))
        pixels = np.int64(word & np.uint64(0xFFFFFFFF))
        if kind in (EVENT_OFF, EVENT_ON) and pixels == 0:  # its time may be none, too
            state[_RESERVED] += word == 0
        elif kind in (EVENT_OFF, EVENT_ON):
            column, row = (upper >> 11) & 0x7FF, upper & 0x7FF
            now = base_t + (upper >> 22)
            state[LATE] += now < last_t
            last_t = max(last_t, now)
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
            step = _step_time(words, i, upper, state, EVT21_TIME)
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
    # A jump in time so close before damage is part of it: what came after the jump is taken back.
    if damage and i - jump_word < SUSPECT_WORDS:
        events, triggers = jump_events, jump_triggers
    state[_LAST_T] = last_t
    return i, events, triggers, damage
