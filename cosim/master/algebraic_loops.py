"""Loops in the graph of direct feedthrough: find them, show one, cut them.

A graph maps each component to the components that receive from it at the same point.
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Mapping, Sequence
from typing import TypeVar

Node = TypeVar("Node")
Costs = Mapping[tuple[int, int], int]

_MOST_EXACT = 10
"""Groups of which the cheapest order is computed exactly: 2 ** 10 sets of groups."""


def strongly_connected(graph: Mapping[Node, Sequence[Node]]) -> list[tuple[Node, ...]]:
    """Return the strongly connected components, each in the order of the graph (Tarjan 1972).

    Components come in the order of their first node in the graph. Two nodes are in one if each
    can be reached from the other; most have a single node.
    """
    place = {node: i for i, node in enumerate(graph)}
    index: dict[Node, int] = {}
    low: dict[Node, int] = {}
    stack: list[Node] = []
    waiting: set[Node] = set()
    found: list[tuple[Node, ...]] = []
    for root in graph:
        if root in index:
            continue
        work = [(root, iter(graph[root]))]
        index[root] = low[root] = len(index)
        stack.append(root)
        waiting.add(root)
        while work:
            node, following = work[-1]
            for other in following:
                if other not in index:
                    index[other] = low[other] = len(index)
                    stack.append(other)
                    waiting.add(other)
                    work.append((other, iter(graph[other])))
                    break
                if other in waiting:
                    low[node] = min(low[node], index[other])
            else:
                work.pop()
                if work:
                    low[work[-1][0]] = min(low[work[-1][0]], low[node])
                if low[node] == index[node]:
                    group = [stack.pop()]
                    while group[-1] != node:
                        group.append(stack.pop())
                    waiting.difference_update(group)
                    found.append(tuple(sorted(group, key=place.__getitem__)))
    return sorted(found, key=lambda group: place[group[0]])


def is_loop(group: Sequence[Node], graph: Mapping[Node, Sequence[Node]]) -> bool:
    """Whether a strongly connected component is a loop: several nodes, or one that meets itself."""
    return len(group) > 1 or group[0] in graph[group[0]]


def shortest_loop(group: Sequence[Node], graph: Mapping[Node, Sequence[Node]]) -> list[Node]:
    """Return the nodes of a shortest loop through the first node of a loop, which ends it too."""
    start, inside = group[0], set(group)
    before: dict[Node, Node] = {}
    queue = deque([start])
    while queue:
        node = queue.popleft()
        for other in graph[node]:
            if other == start:
                way = [start, node]
                while way[-1] != start:
                    way.append(before[way[-1]])
                return way[::-1]
            if other in inside and other not in before:
                before[other] = node
                queue.append(other)
    raise ValueError(f"expected a loop, got {group}")


def cheapest_order(count: int, costs: Costs, fixed: set[tuple[int, int]]) -> list[int]:
    """Return the order of 0 ... count - 1 in which the edges that lead backwards cost least.

    Exact for up to 10; for more, each place goes to the one whose edges from those that are not
    placed yet cost least. Of equal choices the least number comes first.

    Parameters
    ----------
    costs : of each edge (from, to) that may lead backwards.
    fixed : edges that must lead forwards; they make no loop.
    """
    return (_exact if count <= _MOST_EXACT else _greedy)(count, costs, fixed)


def _exact(count: int, costs: Costs, fixed: set[tuple[int, int]]) -> list[int]:
    """Dynamic programming over the set of those placed so far, from the full set backwards."""
    whole = (1 << count) - 1
    needs = [sum(1 << a for a, b in fixed if b == node) for node in range(count)]
    into = [[(a, cost) for (a, b), cost in costs.items() if b == node] for node in range(count)]

    def choices(placed: int) -> list[tuple[float, int]]:
        return [
            (sum(c for a, c in into[node] if not placed >> a & 1) + rest[placed | 1 << node], node)
            for node in range(count)
            if not placed >> node & 1 and needs[node] & ~placed == 0
        ]

    rest = [float("inf")] * whole + [0.0]
    for placed in range(whole - 1, -1, -1):
        rest[placed] = min(choices(placed), default=(float("inf"), 0))[0]
    order: list[int] = []
    placed = 0
    while placed != whole:
        order.append(min(choices(placed))[1])
        placed |= 1 << order[-1]
    return order


def _greedy(count: int, costs: Costs, fixed: set[tuple[int, int]]) -> list[int]:
    missing, price = [0] * count, [0] * count
    after: list[list[tuple[int, int, int]]] = [[] for _ in range(count)]
    for a, b in fixed:
        missing[b] += 1
        after[a].append((b, 1, 0))
    for (a, b), cost in costs.items():
        price[b] += cost
        after[a].append((b, 0, cost))
    heap = [(price[node], node) for node in range(count) if not missing[node]]
    heapq.heapify(heap)
    order: list[int] = []
    placed = [False] * count
    while heap:
        paid, node = heapq.heappop(heap)
        if placed[node] or paid != price[node]:
            continue
        placed[node] = True
        order.append(node)
        for other, need, cost in after[node]:
            if not placed[other]:
                missing[other] -= need
                price[other] -= cost
                if not missing[other]:
                    heapq.heappush(heap, (price[other], other))
    return order
