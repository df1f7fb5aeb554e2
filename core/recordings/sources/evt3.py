"""Prophesee EVT3: 16-bit words that change one thing at a time (row, column, time) or set a row of pixels at once.

Source: Prophesee's EVT3 format description. Words of reserved types and addresses beside
the sensor are left out and counted; the decoder stops where time jumps back for good.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from core.jit import njit
from core.recordings.sources.evt_time import (
    BAD_TIME,
    EVT3_TIME,
    IGNORE,
    NO_DAMAGE,
    STOP,
    SUSPECT_WORDS,
    judge_time_high,
    next_time_high,
)

ADDR_Y: Final = 0x0
OTHER_ROW: Final = 0x1
ADDR_X: Final = 0x2
VECT_BASE_X: Final = 0x3
VECT_12: Final = 0x4
VECT_8: Final = 0x5
TIME_LOW: Final = 0x6
CONTINUED_4: Final = 0x7
TIME_HIGH: Final = 0x8
EXT_TRIGGER: Final = 0xA
OTHERS: Final = 0xE
CONTINUED_12: Final = 0xF

NO_ROW: Final = 1 << 20
"""No row at all: what follows belongs to no event of change."""
_SECOND: Final = EVT3_TIME.second
_MASK: Final = EVT3_TIME.mask
_FEW_LOWS: Final = 3
"""So many fine times one after the other may be ahead of the others by damage."""
_NEAR_WORDS: Final = 256
_PADDING: Final = 4
"""So many words of zeros one after the other are no rows."""

HIGH, LOW, EPOCH, Y, BASE_X, BASE_ON, LAST_T, IGNORED, RESERVED, OUTSIDE, MAX_X, MAX_Y = range(12)


def start_state(words: np.ndarray) -> np.ndarray:
    """The state in front of the first word of a file."""
    first = int(next_time_high(words, 0, EVT3_TIME))
    state = np.zeros(12, np.int64)
    # Cameras repeat the coarse time every few microseconds, so what stands before the first one has that same time;
    # files written by software leave out the coarse time 0.
    state[HIGH] = first if first > 1 else 0
    state[LAST_T] = np.iinfo(np.int64).min
    return state


@njit
def _row(words, at, state):
    """The row that a word names; none where it is one of many zeros in a row: a camera would name row 0 once."""
    word = np.int64(words[at])
    if word != 0:
        return word & 0x7FF
    start, end = at, at + 1
    while start > 0 and at - start < _PADDING and words[start - 1] == 0:
        start -= 1
    while end < len(words) and end - start < _PADDING and words[end] == 0:
        end += 1
    if end - start < _PADDING:
        return word
    state[RESERVED] += 1
    return np.int64(NO_ROW)


@njit
def _were_ahead(words, at, low):
    """Whether the fine time of word `at` is right, which is less than the `low` before it: then that one was damaged.

    It is if the next one goes on from it, and not from `low`, and only a few were ahead.
    """
    value = np.int64(words[at]) & 0xFFF
    following = np.int64(-1)
    for i in range(at + 1, min(at + _NEAR_WORDS, len(words))):
        kind = np.int64(words[i]) >> 12
        if kind in (TIME_LOW, TIME_HIGH):
            following = np.int64(words[i]) & 0xFFF if kind == TIME_LOW else np.int64(-1)
            break
    if not value <= following < low:
        return False
    ahead = 0
    for i in range(at - 1, max(-1, at - _NEAR_WORDS), -1):
        kind = np.int64(words[i]) >> 12
        if kind == TIME_HIGH or (kind == TIME_LOW and np.int64(words[i]) & 0xFFF <= value):
            return ahead <= _FEW_LOWS
        ahead += kind == TIME_LOW
    return False


@njit
def _hold(t, events, latest):
    """Put back the times of the last events that lie behind `latest`."""
    for j in range(events - 1, -1, -1):
        if t[j] <= latest:
            break
        t[j] = latest


@njit
def decode_evt3(words, state, width, height, out):  # noqa: C901 (one branch for each kind of word, commonest first)
    """Decode until the words or the room for events or triggers run out, or the first damage.

    Writes to `out`, a `Decoded`; returns (words used, events, triggers, damage).
    """
    t, x, y, on, trigger_t, trigger_on, trigger_id = out
    high, low, epoch = state[HIGH], state[LOW], state[EPOCH]
    row, base_x, base_on, last_t = state[Y], state[BASE_X], state[BASE_ON], state[LAST_T]
    now = max(last_t, epoch + (high << 12) + low)
    events, triggers, damage = 0, 0, NO_DAMAGE
    jump_word, jump_events, jump_triggers = -SUSPECT_WORDS, 0, 0
    room, trigger_room = len(t) - 12, len(trigger_t)
    i = 0
    while i < len(words) and events <= room and triggers < trigger_room:
        word = np.int64(words[i])
        kind = word >> 12
        if kind == ADDR_X:
            column = word & 0x7FF
            if column >= width or row >= height:
                if row != NO_ROW:
                    state[OUTSIDE] += 1
                    state[MAX_X], state[MAX_Y] = max(state[MAX_X], column), max(state[MAX_Y], row)
            else:
                t[events], x[events], y[events], on[events] = now, column, row, (word >> 11) & 1
                events += 1
        elif kind == TIME_LOW:
            value = word & 0xFFF
            if value >= low:
                low, now = value, max(now, epoch + (high << 12) + value)
            else:
                state[IGNORED] += 1
                if _were_ahead(words, i, low):
                    low, now = value, epoch + (high << 12) + value
                    _hold(t, events, now)
        elif kind == ADDR_Y:
            row = _row(words, i, state)
        elif kind == TIME_HIGH:
            value = word & 0xFFF
            if value != high:
                verdict = judge_time_high(words, i, value, high, EVT3_TIME)
                if verdict == STOP:
                    damage = BAD_TIME
                    break
                if verdict == IGNORE:
                    state[IGNORED] += 1
                else:
                    if ((value - high) & _MASK) > _SECOND:
                        jump_word, jump_events, jump_triggers = i, events, triggers
                    if value < high:
                        epoch += 1 << 24
                    high, low = value, 0  # the fine time follows; the old one would be up to 4 ms late
                    now = max(now, epoch + (high << 12))
        elif kind in (VECT_12, VECT_8):
            bits = 12 if kind == VECT_12 else 8
            for bit in range(bits):
                if (word >> bit) & 1:
                    if base_x + bit >= width or row >= height:
                        if row != NO_ROW:
                            state[OUTSIDE] += 1
                            state[MAX_X], state[MAX_Y] = max(state[MAX_X], base_x + bit), max(state[MAX_Y], row)
                        continue
                    t[events], x[events], y[events], on[events] = now, base_x + bit, row, base_on
                    events += 1
            base_x += bits
        elif kind == VECT_BASE_X:
            base_x, base_on = word & 0x7FF, (word >> 11) & 1
        elif kind == EXT_TRIGGER:
            trigger_t[triggers], trigger_on[triggers], trigger_id[triggers] = now, word & 1, (word >> 8) & 0xF
            triggers += 1
        elif kind not in (CONTINUED_4, OTHERS, CONTINUED_12):  # padding, or words of another vendor
            state[RESERVED] += 1
            if kind == OTHER_ROW:
                row = NO_ROW  # of an event that is none of ours
        i += 1
    if damage and i - jump_word < SUSPECT_WORDS:
        events, triggers = jump_events, jump_triggers
    state[HIGH], state[LOW], state[EPOCH] = high, low, epoch
    state[Y], state[BASE_X], state[BASE_ON], state[LAST_T] = row, base_x, base_on, now
    return i, events, triggers, damage
