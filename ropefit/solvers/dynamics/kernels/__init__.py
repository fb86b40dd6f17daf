"""One rope after the other through time, compiled; see `../solve.py`.

Every step is a small equilibrium: the strains, moments and turns of `equilibrium/kernels`, with the
nodes' inertia and the dampings as terms of an incremental potential. A rate is the second-order
backward difference D[y] = c0 y + c1 y' + c2 y'' of the new value and the two before it (BDF2 for
any steps; the first step has one before it and is backward Euler), so with v = D[x], a = D[v]

    m a + air v + spring x = load + n_k - n_{k-1}   at each free node, n_i the force in segment i
    x_{i+1} - x_i = R_i l (e3 + Γ),        Γ + flexibility strain_viscosity D[Γ] = flexibility Rᵀn
    0 = moments of n and of the bends      about the directors of each segment,
                                           m_j = stiffness (p - rest) + bend_viscosity D[p]

where p is the Darboux vector of a bend and m its moment. A node's x follows from the forces beside
it, so unknown are the turn and the force of each segment: a symmetric block tridiagonal system
(6 x 6), linear cost in N. A rope that does not stretch (flexibility = 0) is no harder than any
other. Segments have no spin inertia.
"""
