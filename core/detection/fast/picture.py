"""DBSCAN over the set pixels of a bit image: the labels of scikit-learn, 64 pixels at a time.

The pixels are numbered row by row. The number of a pixel is the count of set bits before it, so the pixels between two
places of a row have numbers that follow each other, and the events on them are a difference of two running sums.

scikit-learn numbers clusters by their first core point and floods each one completely before the next, so a border
point belongs to the lowest number that reaches it. Events on one pixel share all their neighbours, hence their label.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.detection.fast.bits import LAST, ONE, SIX, lowest_place, popcount
from core.detection.fast.opening import PAD_ROWS, blank_bits
from core.events import SensorSize
from core.jit import njit


class Picture(NamedTuple):
    """Bit images of one shape, flat. Those of core and border pixels are used up by the flood."""

    occupied: NDArray[np.uint64]
    """Every pixel with an event."""
    before: NDArray[np.int64]
    """Number of pixels before each word."""
    cores: NDArray[np.uint64]
    """Core pixels without a label."""
    borders: NDArray[np.uint64]
    """Other pixels without a label."""
    stride: int
    """Words from a row to the next."""
    disc: NDArray[np.int64]
    """(2, K) see `neighbour_rows`."""


class ActivePixels(NamedTuple):
    """The pixels that have events, by number; if time counts, those of the clusters, cluster by cluster."""

    spots: NDArray[np.int32]
    """(N, 4) x, y, OFF events, ON events."""
    sums: NDArray[np.int32]
    """(N + 1,) events on all pixels before."""
    labels: NDArray[np.int32]
    """Cluster of each pixel, or of each event if time counts; -1 for none."""
    members: NDArray[np.int32]
    """Numbers of the pixels with a label, cluster by cluster."""
    starts: NDArray[np.int32]
    """Where each cluster begins in `members`."""
    queue: NDArray[np.int32]
    """Words with core pixels whose neighbours are still to be looked at."""
    masks: NDArray[np.uint64]
    """Those pixels."""
    pixel_of: NDArray[np.int32]
    """Number of the pixel of each event."""


SPOT_LISTS: Final = 10
"""Of 32-bit numbers that `Spots` consists of."""


def neighbour_rows(eps_px: float) -> NDArray[np.int64]:
    """(2, K) the rows of the disc of radius eps, the nearest first: distance of the row, half its width."""
    reach = math.floor(eps_px)
    rows = sorted(range(-reach, reach + 1), key=abs)
    widths = [max(w for w in range(reach + 1) if w * w + dy * dy <= eps_px * eps_px) for dy in rows]
    return np.array([rows, widths], np.int64)


def blank_picture(sensor: SensorSize, eps_px: float, room: int) -> tuple[Picture, ActivePixels]:
    """Without events, with room for so many."""
    shape = blank_bits(sensor).shape
    words = np.zeros((4, shape[0] * shape[1]), np.uint64)
    picture = Picture(words[0], words[1].view(np.int64), words[2], words[3], shape[1], neighbour_rows(eps_px))
    lists = np.zeros((SPOT_LISTS, room + 2), np.int32)
    return picture, spots_of(lists, np.zeros(room + 2, np.uint64))


@njit
def spots_of(lists, masks):
    """The named views of lists of numbers."""
    room = lists.shape[1]
    spots = lists[:4].reshape((room, 4))
    return ActivePixels(spots, lists[4], lists[5], lists[6], lists[7], lists[8], masks, lists[9])


@njit
def _number_pixels(picture, box, spots):
    """Number the pixels inside the box of words; returns how many there are."""
    row_first, row_last, word_first, word_last = box
    pixels = 0
    for row in range(row_first, row_last + 1):
        # One word more on both sides: the neighbourhood of a pixel may reach into it.
        for place in range(row * picture.stride + word_first - 1, row * picture.stride + word_last + 2):
            picture.before[place] = pixels
            word = picture.occupied[place]
            x = (place - row * picture.stride - 1) * 64
            while word:
                spots[pixels, 0], spots[pixels, 1] = x + lowest_place(word), row - PAD_ROWS
                spots[pixels, 2], spots[pixels, 3] = 0, 0
                word &= word - ONE
                pixels += 1
    return pixels


@njit
def count_events(x_px, y_px, on, events, box, picture, found):
    """Number the pixels of these events, which are in `picture`, and count them there; returns how many pixels."""
    pixels = _number_pixels(picture, box, found.spots)
    for k in range(len(events)):
        i = np.uint64(events[k])
        bit = np.uint64(((y_px[i] + PAD_ROWS) * picture.stride + 1) * 64 + x_px[i])
        pixel = rank(picture, bit)
        found.pixel_of[k] = pixel
        found.spots[pixel, 3 if on[i] else 2] += 1
    return pixels


@njit(forceinline=True)
def rank(picture, bit):
    """How many pixels are set before a place, counted in bits from the first word."""
    place = bit >> SIX
    return picture.before[place] + popcount(picture.occupied[place] & ((ONE << (bit & LAST)) - ONE))


@njit
def label_pixels(count, pixels, box, picture, found, min_samples):
    """DBSCAN over the pixels of `count` events, in the order of their first ones; returns the number of clusters."""
    found.sums[0] = 0
    for pixel in range(pixels):
        found.sums[pixel + 1] = found.sums[pixel] + found.spots[pixel, 2] + found.spots[pixel, 3]
    found.labels[:pixels] = -1
    cores = _find_cores(picture, box, found.sums, min_samples)
    clusters, members = 0, 0
    found.starts[0] = 0
    for k in range(count):
        if not cores:
            break
        pixel = found.pixel_of[k]
        if found.labels[pixel] >= 0:
            continue
        x, y = np.int64(found.spots[pixel, 0]), np.int64(found.spots[pixel, 1])
        place = (y + PAD_ROWS) * picture.stride + 1 + (x >> 6)
        bit = ONE << np.uint64(x & 63)
        if picture.cores[place] & bit:
            members, taken = _flood(picture, box, found, (place, bit), clusters, members)
            cores -= taken
            clusters += 1
            found.starts[clusters] = members
    return clusters


@njit
def clear_picture(box, picture):
    """No pixels any more."""
    row_first, row_last, word_first, word_last = box
    for row in range(row_first, row_last + 1):
        for place in range(row * picture.stride + word_first, row * picture.stride + word_last + 1):
            picture.occupied[place] = 0
            picture.borders[place] = 0


@njit
def _find_cores(picture, box, sums, min_samples):
    """Sort the pixels into cores and borders; returns how many cores there are."""
    row_first, row_last, word_first, word_last = box
    count = 0
    for row in range(row_first, row_last + 1):
        for place in range(row * picture.stride + word_first, row * picture.stride + word_last + 1):
            left, cores = picture.occupied[place], np.uint64(0)
            while left:
                lowest = left & (~left + ONE)
                left ^= lowest
                bit = place * 64 + lowest_place(lowest)
                if _is_core(picture, bit, row, row_first, row_last, sums, min_samples):
                    cores |= lowest
                    count += 1
            picture.cores[place] = cores
            picture.borders[place] = picture.occupied[place] & ~cores
    return count


@njit(forceinline=True)
def _is_core(picture, bit, row, row_first, row_last, sums, min_samples):
    near = 0
    for k in range(picture.disc.shape[1]):
        dy, width = picture.disc[0, k], picture.disc[1, k]
        if row_first <= row + dy <= row_last:
            start = np.uint64(bit + dy * picture.stride * 64 - width)
            near += sums[rank(picture, start + np.uint64(2 * width + 1))] - sums[rank(picture, start)]
            if near >= min_samples:
                return True
    return False


@njit
def _flood(picture, box, found, seed, cluster, members):
    """Label all that a core pixel reaches; returns the end of the members and how many cores were among them."""
    first, end = box[0] * picture.stride, (box[1] + 1) * picture.stride
    nearest = picture.disc[1, 0]
    place, mask = seed
    mask = _take_word(picture.cores, place, mask, nearest)
    members, cores = _enter(picture, found, place, mask, cluster, members), popcount(mask)
    found.queue[0], found.masks[0] = place, mask
    done, count = 0, 1
    while done < count:
        place, mask = np.int64(found.queue[done]), found.masks[done]
        done += 1
        wide, before, after, reach = mask, np.uint64(0), np.uint64(0), 0
        for k in range(picture.disc.shape[1] - 1, -1, -1):  # the farthest and narrowest row first
            while reach < picture.disc[1, k]:
                reach += 1
                by, rest = np.uint64(reach), np.uint64(64 - reach)
                wide |= (mask << by) | (mask >> by)
                before |= mask << rest
                after |= mask >> rest
            middle = place + picture.disc[0, k] * picture.stride
            if middle < first or middle >= end:
                continue
            for side in range(-1, 2):
                near = wide if side == 0 else (before if side < 0 else after)
                if not near:
                    continue
                other = middle + side
                edge = picture.borders[other] & near
                if edge:
                    picture.borders[other] ^= edge
                    members = _enter(picture, found, other, edge, cluster, members)
                core = picture.cores[other] & near
                if core:
                    core = _take_word(picture.cores, other, core, nearest)
                    members = _enter(picture, found, other, core, cluster, members)
                    cores += popcount(core)
                    found.queue[count], found.masks[count] = other, core
                    count += 1
    return members, cores


@njit(forceinline=True)
def _take_word(cores, place, mask, reach):
    """Take all core pixels of a word that hang together with some of it."""
    free = cores[place]
    while True:
        wide = mask
        for shift in range(1, reach + 1):
            by = np.uint64(shift)
            wide |= (mask << by) | (mask >> by)
        wide &= free
        if wide == mask:
            break
        mask = wide
    cores[place] = free ^ mask
    return mask


@njit(forceinline=True)
def _enter(picture, found, place, mask, cluster, members):
    """Give pixels of a word a label; returns the end of the members."""
    occupied, start = picture.occupied[place], picture.before[place]
    while mask:
        lowest = mask & (~mask + ONE)
        mask ^= lowest
        pixel = start + popcount(occupied & (lowest - ONE))
        found.labels[pixel] = cluster
        found.members[members] = pixel
        members += 1
    return members
