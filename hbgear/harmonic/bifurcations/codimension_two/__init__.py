"""Points of codimension two on curves of folds, period doublings and Neimark-Sacker points in two parameters.

RI    1:1 resonance, a double multiplier +1: on folds w^T D_s v = 0; the end of a Neimark-Sacker curve.
RII   1:2 resonance, a double multiplier -1: on period doublings w^T D_s v = 0; the end of a Neimark-Sacker curve.
RIII  1:3 resonance: cos theta = -1/2 on a Neimark-Sacker curve, theta the angle of the multipliers.
RIV   1:4 resonance: cos theta = 0.
FF    fold-flip, multipliers +1 and -1: the other of the two blocks of the doubled problem is singular.
LPNS  fold-Neimark-Sacker, a multiplier +1 and a pair on the unit circle; PDNS with -1 (flip-Neimark-Sacker).
NSNS  double Neimark-Sacker, two pairs on the unit circle.
GPD   generalised period doubling: the cubic coefficient of the doubled branch is zero,

    w^T [R_XX h v + R_XXX v v v / 6] = 0,   R_X h = -R_XX v v / 2

v and w are the null vectors at the point, D(s) is Hill's determinant in real coefficients and D_s its derivative in
the exponent. All are zeros of smooth functions along the curve, located as bracketed roots. Their signs do not depend
on the signs of v and w: they are multiplied by the sign of the determinant of [A w; v^T 0], A v = 0.

The test function of another pair is the smallest |mu_i mu_j - 1| over all pairs of multipliers, without those of the
point itself, with the sign of the product of all mu_i mu_j - 1. It is zero at neutral saddles as well, where the two
multipliers are real. Newton's method on the equations of the curve and Re s = 0, s the exponent of the pair from Hill's
determinant, locates the point. On curves of Neimark-Sacker points the determinants of dR/dX and of the half-integer
block are zero at LPNS and PDNS.

A curve of Neimark-Sacker points leaves a resonance RI or RII on the side where the two exponents with zero sum are
imaginary. Its first point is solved next to the resonance, since the equations of the pair are singular there.

Cusps (CP) are turning points of curves of folds; see `hbgear.continuation.events.fold`.

References
----------
Kuznetsov, Elements of Applied Bifurcation Theory (2004), ch. 9, https://doi.org/10.1007/978-1-4757-3978-7.
Kuznetsov & Meijer (2005), SIAM J. Sci. Comput. 26(6), https://doi.org/10.1137/030601508.
"""
