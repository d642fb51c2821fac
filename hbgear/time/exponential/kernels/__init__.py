"""Kernels that integrate motions by steps in which the linear part is exact: see `integrator`.

    zeta' = poles zeta - input w,   d, v = Re(output zeta) + steady(tau),   w = p - kr d

For displacements e with breakpoints, steady contains -e, and w = p - kr (d + e) - c e'.

The period is divided into N cells. The tables of a step over a whole cell are stored; those of a partial step
(x, x + length) are computed. Newton's iteration for w at the Gauss points ends after the first step if the laws are
linear on their segments. A step in which an element leaves its segment is repeated up to the breakpoint, followed by a
step over the rest of the cell. A cell in which the excitation has breakpoints is divided, too. A contact between teeth
has the segments d < level(tau) and d > level(tau); its level is a cubic on a step.

Laws that no table holds are evaluated in Python: `integrate_segments` then returns whenever it needs their forces.

Functions that are called for every step create no views of arrays and take no tuples of them: reference counting would
cost more than the step. The arguments of the largest are gathered once for each motion and passed with a star, which
counts no references.
"""
