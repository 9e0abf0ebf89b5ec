"""The natural frequencies of MuJoCo's flexible bodies, from the elasticity of their elements."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Float64, Int64

Arrays = Mapping[str, NDArray[Any]]

EDGES = {2: ((1, 2), (2, 0), (0, 1)), 3: ((0, 1), (1, 2), (2, 0), (2, 3), (0, 3), (1, 3))}
"""The edges of an element, as pairs of its vertices, by dimension (`mj_passive`)."""
NEEDED = (
    *("dim", "interp", "damping", "elem", "elemnum", "elemdataadr", "stiffness", "stiffnessadr"),
    *("vert", "vertadr", "vertnum", "vertbodyid"),
)
"""Fields of the model that define a flexible body's elasticity, without the prefix `flex_`."""
EULER = 0
"""The integrator whose steps are explicit in elastic forces (`mjtIntegrator`)."""
SLIDES = 3
"""Number of joints of a node that moves freely."""
MOST = 2000
"""Maximum number of nodes: the largest eigenvalue of more takes too long."""


def elasticity_of(arrays: Arrays, flex: int) -> tuple[float, ...]:
    """Return the largest natural frequency of a flexible body [rad/s], and its damping [s].

    The damping is omitted unless the integrator is Euler, the only one that is explicit in elastic
    forces. The result is empty if the body is not elastic, or if its nodes are not its vertices.
    For edges with the squares s of their lengths, MuJoCo's force at a vertex x is -Σ S (s - s₀)
    ∂s/2∂x, with the stiffness S of each element. At rest ∂s/∂x is ±2 (x - x'), so that the
    stiffness matrix of all edges is K = 2 Bᵀ S B, with the rows ±(x - x') of B; the largest
    eigenvalue of M⁻¹ K is the square of the frequency.
    """
    if not all(f"flex_{name}" in arrays for name in NEEDED):  # an earlier version
        return ()
    dim, count, nodes = (int(_of(arrays, name, flex)) for name in ("dim", "elemnum", "vertnum"))
    begin, at, first = (
        int(_of(arrays, name, flex)) for name in ("stiffnessadr", "elemdataadr", "vertadr")
    )
    stiffness = np.ravel(arrays["flex_stiffness"])
    if dim not in EDGES or _of(arrays, "interp", flex) or begin < 0 or nodes > MOST:
        return ()
    each = len(stiffness) // int(np.sum(arrays["flex_elemnum"]))
    kept = stiffness[begin : begin + each * count].reshape(count, each)
    elements = np.ravel(arrays["flex_elem"])[at : at + (dim + 1) * count].reshape(count, dim + 1)
    vertices = slice(first, first + nodes)
    bodies = np.ravel(arrays["flex_vertbodyid"])[vertices]
    places_m = np.reshape(arrays["flex_vert"], (-1, 3))[vertices]
    free = np.ravel(arrays["body_dofnum"])[bodies] == SLIDES
    places_m = places_m + np.where(free[:, None], np.asarray(arrays["body_pos"])[bodies], 0.0)
    masses_kg = np.where(free, np.ravel(arrays["body_mass"])[bodies], np.inf)
    if not kept.any():
        return ()
    highest = _largest(elements, kept, places_m, masses_kg, EDGES[dim])
    explicit = int(np.ravel(arrays["opt.integrator"])[0]) == EULER
    return (float(np.sqrt(highest)), *([_of(arrays, "damping", flex)] if explicit else []))


def _of(arrays: Arrays, name: str, flex: int) -> float:
    return float(np.atleast_1d(arrays[f"flex_{name}"])[flex])


def _largest(
    elements: Int64,
    stiffness: Float64,
    places_m: Float64,
    masses_kg: Float64,
    edges: tuple[tuple[int, int], ...],
) -> float:
    """Return the largest eigenvalue of M⁻¹ K [1/s²]."""
    from scipy.sparse import coo_array  # takes a while
    from scipy.sparse.linalg import eigsh

    count, size = len(elements), len(edges)
    which = np.triu_indices(size)
    own = np.zeros((count, size, size))
    own[:, which[0], which[1]] = own[:, which[1], which[0]] = stiffness[:, : len(which[0])]
    a, b = (elements[:, [edge[side] for edge in edges]] for side in (0, 1))
    along = places_m[a] - places_m[b]
    rows = np.repeat(np.arange(count * size), 6)
    columns = np.concatenate([3 * each[..., None] + np.arange(3) for each in (a, b)], axis=-1)
    values = np.concatenate([along, -along], axis=-1)
    shape = count * size, 3 * len(places_m)
    stretches = coo_array((values.ravel(), (rows, columns.ravel())), shape=shape).tocsr()
    places = np.arange(count * size).reshape(count, size)
    pairs = [
        np.broadcast_to(each, own.shape).ravel() for each in (places[:, :, None], places[:, None])
    ]
    together = coo_array((own.ravel(), (pairs[0], pairs[1])), shape=(shape[0],) * 2)
    light = np.repeat(1 / np.sqrt(masses_kg), 3)
    scaled = coo_array((light, (np.arange(shape[1]),) * 2), shape=(shape[1],) * 2).tocsr()
    whole = 2 * scaled @ stretches.T @ together.tocsr() @ stretches @ scaled
    start = np.random.default_rng(0).standard_normal(shape[1])
    return float(eigsh(whole, k=1, which="LA", v0=start, return_eigenvectors=False, tol=1e-3)[0])
