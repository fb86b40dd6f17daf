"""Strands linked into one path: through crossings and over hidden stretches, as smoothly as can
be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ropefit.perception import chaining
from ropefit.perception.bridges import costs, distances, tips_of
from ropefit.perception.trace import polyline_arc

# A rope that is hidden goes on about as it went: a link that is chosen by itself may turn by this
# much at either side of the gap, off the straight connection [rad].
MOST_TURN = 1.3
LONG, OWN = 15.0, 0.15  # widths, share of the longest strand: a loose end as long is rope
STRAIGHT = 0.2  # rad: a shorter one is where it is near and the way to it turns less
BESIDE = 7.0  # widths from both ends of a link: a strand that begins and ends there is a loop
MOST_STRANDS = 250
MAIN = 0.9  # of the length of all strands: where a few have more, the others are specks

Member = tuple[int, bool]  # piece of a chain, whether it is walked backwards


@dataclass(frozen=True)
class Path:
    """points (P, 2) [px] in order; seen (P,): False on bridges over what the mask does not show;
    bridged: number of links that were made."""

    points: np.ndarray
    seen: np.ndarray
    bridged: int

    @property
    def length(self) -> float:
        return float(polyline_arc(self.points)[-1])


def link(
    lines: list[np.ndarray], width: float, ends: np.ndarray, depth: np.ndarray | None = None
) -> list[Path]:
    """Return paths that the strands (P, 2) [px] make, longest first. ends (2, 2) [px], NaN where
    unknown.

    Between two known ends the chain of a few strands is the best there is (chaining.py); else every
    end is linked to at most one other, the cheapest links first. A known end of the rope takes part
    as a point from which one link leads. The path of the known ends comes first and begins at end
    0. With depth (H, W) [m], 0 = none, gaps count in space: what lies beside the rope in the
    picture may stand before or behind it.
    """
    if not lines:
        return []
    order = np.argsort([-len(line) for line in lines])[:MOST_STRANDS]
    lines = [lines[i] for i in order]
    known = np.flatnonzero(np.isfinite(ends).all(axis=1))
    pieces = [*lines, *(ends[i][None] for i in known)]
    tips, ways = tips_of(pieces, width)
    away = np.zeros(len(tips)) if depth is None else distances(pieces, width, depth)
    cost, turn = costs(pieces, tips, ways, away, len(lines), width)
    few = [len(line) for line in lines[: chaining.MOST_CHAINED]]
    if len(known) == 2 and sum(few) > MAIN * sum(len(line) for line in lines):
        chains = _exactly(few, cost, len(lines))
    else:
        chains = _greedily(lines, cost, turn, tips, known, width)
    paths = []
    for members in chains:
        members = _without_clutter(members, pieces, tips, ways, len(lines), width)
        path = _joined(pieces, tips, ways, members, len(lines))
        if len(known) and members[0][0] == len(lines) and known[0] == 1:
            path = _reversed(path)
        paths.append((members[0][0] >= len(lines), path))
    paths.sort(key=lambda item: (not item[0], -item[1].length))
    return [path for _, path in paths]


def _exactly(lengths: list[int], cost: np.ndarray, count: int) -> list[list[Member]]:
    """Return the best chain from known end to known end of the first few of `count` strands, of
    lengths [px]."""
    tips = slice(2 * len(lengths))
    first, last = cost[2 * count, tips], cost[2 * count + 2, tips]
    chain = chaining.best_chain(cost[tips, tips], np.array(lengths, dtype=float), first, last)
    return [[(count, False), *chain, (count + 1, False)]] if chain else []


def _greedily(
    lines: list[np.ndarray],
    cost: np.ndarray,
    turn: np.ndarray,
    tips: np.ndarray,
    known: np.ndarray,
    width: float,
) -> list[list[Member]]:
    """Return chains of many strands: every end is linked to at most one other, the cheapest
    first."""
    count = len(lines)
    partner = np.full(len(tips), -1)
    chain = np.arange(len(tips) // 2)  # number of the chain that each piece belongs to
    _cheapest_first(np.where(np.maximum(turn, turn.T) > MOST_TURN, np.inf, cost), partner, chain)
    round_ = np.array([_comes_back(line, width) for line in lines], dtype=bool)
    _put_loops_in(partner, tips, turn, round_, width)
    chains = []
    used = np.zeros(len(tips) // 2, dtype=bool)
    starts = [count + k for k in range(len(known))]
    starts += [i for i in range(count) if partner[2 * i] < 0 or partner[2 * i + 1] < 0]
    for first in starts:
        if used[first]:
            continue
        members = _follow(first, partner, used, count)
        if any(piece < count for piece, _ in members):
            chains.append(members)
    return chains


def _cheapest_first(cost: np.ndarray, partner: np.ndarray, chain: np.ndarray) -> None:
    """Link loose ends in order of cost (2N, 2N), written into partner (2N,), without making rings.
    chain (N,): number of the chain that each piece belongs to."""
    total = len(cost)
    flat = np.argsort(cost, axis=None, kind="stable")
    for index in flat[: int(np.isfinite(cost).sum())]:
        a, b = divmod(int(index), total)
        if a >= b or partner[a] >= 0 or partner[b] >= 0:
            continue
        one, other = chain[a // 2], chain[b // 2]
        if one != other:
            partner[a], partner[b] = b, a
            chain = np.where(chain == other, one, chain)


def _comes_back(piece: np.ndarray, width: float) -> bool:
    """Return whether a strand (P, 2) ends near where it began, after some way."""
    apart = float(np.linalg.norm(piece[-1] - piece[0]))
    return len(piece) > BESIDE * width and apart < 0.5 * len(piece)


def _put_loops_in(
    partner: np.ndarray, tips: np.ndarray, turn: np.ndarray, round_: np.ndarray, width: float
) -> None:
    """Take loops of the rope into the link beside which they begin and end. round_ (N,): strands
    that come back.

    Where a rope crosses itself at a small angle, the short way past its loop looks as smooth as the
    way around, but then the loop would be left over.
    """
    for piece in np.flatnonzero(round_).tolist():
        a, b = 2 * piece, 2 * piece + 1
        if partner[a] >= 0 or partner[b] >= 0:
            continue
        first = np.flatnonzero(partner > np.arange(len(partner)))  # one end of every link
        second = partner[first]
        away = [np.linalg.norm(tips[side] - tips[tip], axis=1) for tip in (a, b)
                for side in (first, second)]  # fmt: skip
        worst = np.max(away, axis=0) if len(first) else np.empty(0)
        if worst.size == 0 or worst.min() > BESIDE * width:
            continue
        link = int(np.argmin(worst))
        x, y = int(first[link]), int(second[link])
        straight = turn[x, a] ** 2 + turn[a, x] ** 2 + turn[y, b] ** 2 + turn[b, y] ** 2
        crossed = turn[x, b] ** 2 + turn[b, x] ** 2 + turn[y, a] ** 2 + turn[a, y] ** 2
        if crossed < straight:
            a, b = b, a
        partner[x], partner[a], partner[y], partner[b] = a, x, b, y


def _follow(first: int, partner: np.ndarray, used: np.ndarray, count: int) -> list[Member]:
    """Return [(piece, reversed)] from a piece with a loose end to the other end of its chain."""
    entering = 0 if first >= count or partner[2 * first] < 0 else 1
    members, at = [], 2 * first + entering
    while True:
        piece = at // 2
        used[piece] = True
        members.append((piece, at % 2 == 1))
        leaving = at if piece >= count else at ^ 1
        if piece >= count and len(members) > 1:
            return members
        following = partner[leaving]
        if following < 0:
            return members
        at = int(following)


def _without_clutter(
    members: list[Member],
    pieces: list[np.ndarray],
    tips: np.ndarray,
    ways: np.ndarray,
    count: int,
    width: float,
) -> list[Member]:
    """Return the chain less short strands at its loose ends that do not go on as the rope goes.

    Whatever lies near the end of a rope would be linked to it; what is long counts as rope, and
    what is short only where the way to it is straight.
    """
    longest = max(len(pieces[piece]) for piece, _ in members)
    for _ in range(2):  # one end, then the other
        while len(members) > 1:
            (piece, flipped), (before, turned) = members[-1], members[-2]
            if piece >= count or len(pieces[piece]) >= min(LONG * width, OWN * longest):
                break
            a = 2 * before + (0 if turned else 1) if before < count else 2 * before
            b = 2 * piece + (1 if flipped else 0)
            gap = float(np.linalg.norm(tips[b] - tips[a]))
            chord = (tips[b] - tips[a]) / max(gap, 1e-9)
            straight = min(ways[a] @ chord, -ways[b] @ chord, -ways[a] @ ways[b])
            if straight > np.cos(STRAIGHT) and gap < len(pieces[piece]):
                break
            members = members[:-1]
        members = [(piece, not flipped) for piece, flipped in reversed(members)]
    return members


def _joined(
    pieces: list[np.ndarray],
    tips: np.ndarray,
    ways: np.ndarray,
    members: list[Member],
    count: int,
) -> Path:
    """Return the chain as one path of about one point a pixel, its bridges cubic."""
    points, seen = [], []
    last: int | None = None
    for piece, flipped in members:
        entering = 2 * piece + (1 if flipped else 0)
        if last is not None:
            bridge = _hermite(tips[last], ways[last], tips[entering], -ways[entering])
            points.append(bridge)
            seen.append(np.zeros(len(bridge), dtype=bool))
        line = pieces[piece][::-1] if flipped else pieces[piece]
        points.append(line)
        seen.append(np.full(len(line), piece < count))
        last = 2 * piece if piece >= count else entering ^ 1
    return Path(np.concatenate(points), np.concatenate(seen), len(members) - 1)


def _hermite(a: np.ndarray, along_a: np.ndarray, b: np.ndarray, along_b: np.ndarray) -> np.ndarray:
    """Return (N, 2) points strictly between a and b, leaving and arriving in the given
    directions."""
    distance = float(np.linalg.norm(b - a))
    count = int(distance)
    if count < 2:
        return np.empty((0, 2))
    chord = (b - a) / distance
    # A point gives no direction: the straight one.
    start = (along_a if along_a.any() else chord) * distance
    stop = (along_b if along_b.any() else chord) * distance
    t = (np.arange(1, count) / count)[:, None]
    return (
        (2 * t**3 - 3 * t**2 + 1) * a
        + (t**3 - 2 * t**2 + t) * start
        + (-2 * t**3 + 3 * t**2) * b
        + (t**3 - t**2) * stop
    )


def _reversed(path: Path) -> Path:
    return Path(path.points[::-1], path.seen[::-1], path.bridged)
