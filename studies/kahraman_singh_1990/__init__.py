"""Kahraman & Singh (1990): the spur gear pair with backlash, its jumps, basins and chaos.

A. Kahraman, R. Singh, "Non-linear dynamics of a spur gear pair", J. Sound Vib. 142(1) (1990) 49-75: one degree of
freedom, x'' + 2 zeta x' + f(x) = F_m + F_ah Omega^2 cos(Omega t), with zeta = 0.05. The paper has figures only, so the
results are checked against closed forms and time integration.
"""
