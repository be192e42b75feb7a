"""From the binary tree to the tree that rays traverse: eight children per node, eight triangles per leaf, in lanes."""

import numpy as np

from raytrace.accel.boxes import BOX, half_area, high, low
from raytrace.accel.grow import Binary
from raytrace.accel.lanes import NODE, machine_epsilon
from raytrace.accel.layout import CHILD, LEAF_SIZE, NODE_SIZE, PRESENT, PRIM_ID, Leaves
from raytrace.jit import inlined, kernel
from raytrace.records import Nodes

WIDEN = 8.0  # machine epsilons of a leaf's largest coordinate, so that hits stay in the box despite rounding


@inlined
def open_widest(tree: Binary, kids, number: int) -> bool:
    """Replace the inner child of largest area by its two children; return False where all are leaves."""
    widest, largest = -1, -1.0
    for k in range(number):
        if tree.left[kids[k]] > 0 and half_area(tree.bounds, BOX * kids[k]) > largest:
            widest, largest = k, half_area(tree.bounds, BOX * kids[k])
    if widest < 0:
        return False
    left = tree.left[kids[widest]]
    kids[widest], kids[number] = left, left + 1
    return True


@kernel
def fill_leaves(tree: Binary, sources, begin: int, end: int, leaves: Leaves, triangles):
    """Copy the triangles of binary leaves into the lanes of some leaves."""
    for leaf in range(begin, end):
        first, count = tree.first[sources[leaf]], tree.count[sources[leaf]]
        for k in range(NODE):
            number = tree.order[first + k] if k < count else -1
            leaves.prim_id[leaf * LEAF_SIZE + PRIM_ID + k] = number
            for row in range(12):
                at = leaf * LEAF_SIZE + k + NODE * (row if row < 9 else row + 1)
                leaves.rows[at] = triangles[number, row] if k < count else 0.0


@inlined
def fill_box(nodes: Nodes, at: int, bounds, i: int, eps):
    """Write the bounds of a child, widened by the rounding error of the tests of what is inside."""
    largest = 0.0
    for axis in range(BOX):
        largest = abs(bounds[i + axis]) if abs(bounds[i + axis]) > largest else largest
    for axis in range(3):
        nodes.bounds[at + axis * NODE] = low(bounds, i, axis) - largest * (WIDEN * eps)
        nodes.bounds[at + (axis + 3) * NODE] = high(bounds, i, axis) + largest * (WIDEN * eps)


@kernel
def flatten(tree: Binary, nodes: Nodes, sources, stack, kids):
    """Collapse a binary tree into nodes of eight children; return the numbers of nodes, leaves and levels.

    Of the children that a node has so far, the one of largest area is opened first. The numbers of the binary leaves
    are written to ``sources``.
    """
    eps = machine_epsilon(nodes.bounds)
    stack[0, :] = 0
    number_of_nodes, number_of_leaves, levels, top = 1, 0, 1, 1
    while top > 0:
        top -= 1
        source, node, level = stack[top, 0], stack[top, 1], stack[top, 2]
        levels = level + 1 if level >= levels else levels
        kids[0], number = source, 1
        while number < NODE and open_widest(tree, kids, number):
            number += 1
        nodes.child[node * NODE_SIZE + PRESENT] = (1 << number) - 1
        for k in range(NODE):
            nodes.child[node * NODE_SIZE + CHILD + k] = 0
            if k >= number:
                for row in range(6):
                    nodes.bounds[node * NODE_SIZE + row * NODE + k] = np.inf if row < 3 else -np.inf
                continue
            fill_box(nodes, node * NODE_SIZE + k, tree.bounds, BOX * kids[k], eps)
            if tree.left[kids[k]] == 0:
                sources[number_of_leaves] = kids[k]
                nodes.child[node * NODE_SIZE + CHILD + k] = ~number_of_leaves
                number_of_leaves += 1
                continue
            nodes.child[node * NODE_SIZE + CHILD + k] = number_of_nodes
            stack[top, 0], stack[top, 1], stack[top, 2] = kids[k], number_of_nodes, level + 1
            number_of_nodes += 1
            top += 1
    return number_of_nodes, number_of_leaves, levels
