"""The best chain that a few strands make, by dynamic programming over all of them."""

from __future__ import annotations

import numpy as np

MOST_CHAINED = 11  # strands: the states are as many as their subsets
WORTH = 2.0  # px of bridge that a pixel of rope, seen, is worth


def best_chain(
    cost: np.ndarray, length: np.ndarray, first: np.ndarray, last: np.ndarray
) -> list[tuple[int, bool]]:
    """Return [(piece, reversed)] of the chain that explains most with the cheapest bridges.

    Pieces n have tips 2n and 2n + 1. cost (2N, 2N) [px] of a bridge from tip to tip, infinite where
    there can be none; length (N,) [px] of the pieces; first, last (2N,) [px] cost of beginning, of
    ending the chain at a tip. The answer is exact (Held and Karp, with optional pieces:
    each is worth WORTH times its length). Empty where N is 0 or nothing can be begun and ended.
    """
    count = len(length)
    if count == 0:
        return []
    # value[set, tip]: of chains through a set of pieces that end by leaving a piece at a tip.
    value = np.full((1 << count, 2 * count), -np.inf)
    before = np.full((1 << count, 2 * count), -1)
    sets = np.arange(1 << count)
    size = sum((sets >> n) & 1 for n in range(count))
    for tip in range(2 * count):
        value[1 << (tip // 2), tip ^ 1] = WORTH * length[tip // 2] - first[tip]
    for many in range(1, count):
        layer = sets[size == many]
        for tip in range(2 * count):
            piece = tip // 2
            old = layer[(layer >> piece) & 1 == 0]
            reached = value[old] - cost[:, tip]
            choice = reached.argmax(axis=1)
            new = old | (1 << piece)
            value[new, tip ^ 1] = reached[np.arange(len(old)), choice] + WORTH * length[piece]
            before[new, tip ^ 1] = choice
    total = value - last
    at, tip = np.unravel_index(int(total.argmax()), total.shape)
    if not np.isfinite(total[at, tip]):
        return []
    members = []
    at, tip = int(at), int(tip)
    while tip >= 0:
        members.append((tip // 2, tip % 2 == 0))
        at, tip = at & ~(1 << (tip // 2)), int(before[at, tip])
    return members[::-1]
