"""Neighbour graphs of points, pieces joined by their shortest links."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from scipy.spatial import KDTree

from ropefit.perception.trace import FrameRejected

MOST_PIECES = 60
NEIGHBOURS = 8
FARTHEST = 2.0  # times the longest tenth of the links that join the points into one piece


def neighbour_graph(nodes: np.ndarray) -> csr_array:
    """Return (N, N) distances [same unit as nodes (N, D)] from each point to its nearest
    neighbours.

    Neighbours much farther than the points need to hang together are ignored: they may lie on
    another stretch of the rope that passes nearby.
    """
    found = KDTree(nodes).query(nodes, k=min(NEIGHBOURS + 1, len(nodes)))
    distance, neighbour = np.asarray(found[0]), np.asarray(found[1])
    rows = np.repeat(np.arange(len(nodes)), distance.shape[1] - 1)
    columns = neighbour[:, 1:].ravel()
    values = np.maximum(distance[:, 1:].ravel(), 1e-9)
    graph = coo_array((values, (rows, columns)), shape=(len(nodes),) * 2).tocsr()
    needed = minimum_spanning_tree(graph).data
    near = values <= FARTHEST * np.percentile(needed, 90)
    return coo_array((values[near], (rows[near], columns[near])), shape=graph.shape).tocsr()


def bridge(graph: csr_array, nodes: np.ndarray) -> csr_array:
    """Join the connected components of a graph by the shortest links between them.

    Raises FrameRejected when there are too many pieces to be one rope.
    """
    count, label = connected_components(graph, directed=False)
    if count == 1:
        return graph
    if count > MOST_PIECES:
        raise FrameRejected(f"the points fall into {count} separate pieces")
    gap = np.zeros((count, count))
    pair = np.zeros((count, count, 2), dtype=int)
    members = [np.flatnonzero(label == c) for c in range(count)]
    trees = [KDTree(nodes[m]) for m in members]
    for a in range(count):
        for b in range(a + 1, count):
            found = trees[a].query(nodes[members[b]])
            distance, index = np.asarray(found[0]), np.asarray(found[1])
            nearest = int(np.argmin(distance))
            gap[a, b] = max(distance[nearest], 1e-9)
            pair[a, b] = members[a][index[nearest]], members[b][nearest]
    links = np.argwhere(minimum_spanning_tree(gap).toarray() > 0)
    i, j = pair[tuple(links.T)].T
    bridges = coo_array((gap[tuple(links.T)], (i, j)), shape=graph.shape)
    return (graph + bridges).tocsr()
