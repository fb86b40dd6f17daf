"""Newton's method on the equilibrium of one rope after the other, compiled; see `../solve.py`.

Unknown are the turns δ of the N segments about their own directors (q <- q exp δ/2), the force λ_s
of each support, and where node 0 is if nothing holds it. Everything else follows without error:
the force in segment i is n_i = Σ_{k>i} f_k + Σ_{k_s>i} λ_s d_s, its strain is D Rᵀ n_i, and the
nodes are x_k = x_0 + Σ_{i<k} R_i g_i with g = l (e3 + D u), u = Rᵀ n. So an inextensible rope
(D = 0) is no harder than any other. The solution is the saddle point of

    L = Σ_j bend_j - Σ_i l_i (u3 + u·D u / 2) + Σ_s (λ_s (y_s - d_s·x_0) - c_s λ_s²/2) - x_0·Σ_k f_k

whose derivative in δ is the balance of moments, in λ_s the support's condition d·x + c λ = y. Its
Hessian is block tridiagonal (3 x 3) with a border of one column a support: linear cost in N.
"""
